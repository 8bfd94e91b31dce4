"""A share of the fuzzing in every run of the tests, and planted faults that it must see."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).with_name("run.py")
PLANTED = """
import sys
sys.path.insert(0, {folder!r})
import run, seeds
def read(path):
    {fault}
seeds.all_seeds = lambda: [seeds.Seed("planted", "a.npz", b"x", read)]
run.CASE_CPU_S = 1
run.main()
"""


def fuzz(*command):
    asked = [sys.executable, *map(str, command)]
    return subprocess.run(asked, capture_output=True, text=True, timeout=500, check=False)


def test_changed_files_are_read_or_refused_in_words():
    done = fuzz(RUN, "--seconds", 30, "--first", 0)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    assert json.loads(done.stdout.splitlines()[-1])["cases"] > 20


@pytest.mark.parametrize(
    ("fault", "seen"),
    [
        ("raise KeyError('x')", "KeyError"),
        ("import subprocess; subprocess.run(['true'])", "escape: subprocess.Popen"),
        ("open('/tmp/livehand-fuzz-outside', 'w')", "escape: open"),
        ("from livehand.backend.records.errors import LiveHandError; raise LiveHandError('')", "an empty message"),
    ],
)
def test_a_planted_fault_is_seen(fault, seen):
    done = fuzz("-c", PLANTED.format(folder=str(RUN.parent), fault=fault), "--seconds", 0.5)
    assert done.returncode == 1
    assert seen in done.stdout


@pytest.mark.skipif(not hasattr(signal, "SIGPROF"), reason="needs interval timers")
def test_a_reader_that_never_ends_is_ended():
    done = fuzz("-c", PLANTED.format(folder=str(RUN.parent), fault="sum(1 for _ in iter(int, 1))"), "--seconds", 0.5)
    assert done.returncode == -signal.SIGPROF
