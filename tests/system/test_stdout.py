"""Standard streams that are closed, full, or that nobody reads any more."""

import subprocess
import sys

import pytest

PROGRAM = """
from livehand.backend.system.command import Command, run_commands, say
from livehand.backend.system.process_end import run_process

def work(args):
    with open("work", "w") as file:
        for line in range(2000):
            say(f"line {line} " + 50 * "-")
            file.write(f"{line}\\n")
    return {"summary": "done"}

commands = {"work": Command("work", "", lambda parser: None, work)}
run_process(lambda: run_commands("livehand", "", commands, ["work"]))
"""


def run(tmp_path, shell):
    """(exit code, stdout, stderr, lines of work done) of the program in a shell's command."""
    (tmp_path / "program.py").write_text(PROGRAM)
    command = f"set -o pipefail; {sys.executable} program.py {shell}"
    done = subprocess.run(
        ["bash", "-c", command], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    return done.returncode, done.stdout, done.stderr, len((tmp_path / "work").read_text().splitlines())


def test_the_work_goes_on_when_nobody_reads_any_more(tmp_path):
    code, out, err, lines = run(tmp_path, "| head -1")
    assert (code, err, lines) == (0, "", 2000)
    assert out.startswith("line 0 ")


@pytest.mark.parametrize("closed", [">&-", ">&- 2>&-", "<&- >&- 2>&-"])
def test_closed_streams_are_nowhere_and_never_another_file(tmp_path, closed):
    code, out, err, lines = run(tmp_path, closed)
    assert (code, out, err, lines) == (0, "", "", 2000)
    assert (tmp_path / "work").read_text().splitlines() == [str(line) for line in range(2000)]


@pytest.mark.skipif(sys.platform != "linux", reason="needs /dev/full")
def test_output_that_cannot_be_written_is_an_error_in_words(tmp_path):
    code, _, err, _ = run(tmp_path, "> /dev/full")
    assert code == 1
    assert err == "livehand work: the output cannot be printed (No space left on device); print it elsewhere\n"
