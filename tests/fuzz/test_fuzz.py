"""A share of the fuzzing in every run of the tests, and planted faults that it must see."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).with_name("run.py")
PLANTED = f"""
import sys
sys.path.insert(0, {str(RUN.parent)!r})
import run, seeds
from livehand.backend.records.errors import LiveHandError
def key(path): raise KeyError("x")
def start(path): __import__("subprocess").run(["true"])
def write(path): open("/tmp/livehand-fuzz-outside", "w")
def mute(path): raise LiveHandError("")
def refuse(path): raise LiveHandError("a sentence")
def endless(path): sum(1 for _ in iter(int, 1))
seeds.all_seeds = lambda: [seeds.Seed(read.__name__, "a.npz", b"x", read) for read in (READERS)]
run.CASE_CPU_S = 1
run.main()
"""


def fuzz(*command):
    asked = [sys.executable, *map(str, command)]
    return subprocess.run(asked, capture_output=True, text=True, timeout=500, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", [5, pytest.param(60, marks=pytest.mark.nightly)])
def test_changed_files_are_read_or_refused_in_words(seconds):
    done = fuzz(RUN, "--seconds", seconds, "--first", 0)
    assert done.returncode == 0, done.stdout + done.stderr[-2000:]
    assert json.loads(done.stdout.splitlines()[-1])["cases"] >= 30


@pytest.mark.slow
def test_planted_faults_are_seen():
    done = fuzz("-c", PLANTED.replace("READERS", "key, start, write, mute, refuse"), "--seconds", 1)
    assert done.returncode == 1, done.stderr[-2000:]
    for seen in (
        "KeyError: 'x'",
        "escape: subprocess.Popen",
        "escape: open /tmp/livehand-fuzz-outside",
        "an empty message",
    ):
        assert done.stdout.count(seen) == 1
    assert json.loads(done.stdout.splitlines()[-1])["faults"] == 4


@pytest.mark.slow
@pytest.mark.skipif(not hasattr(signal, "SIGPROF"), reason="needs interval timers")
def test_a_reader_that_never_ends_is_ended():
    done = fuzz("-c", PLANTED.replace("READERS", "endless, refuse"), "--seconds", 4)
    assert done.returncode == 1
    assert "    case 0: SIGPROF\n" in done.stdout
    assert json.loads(done.stdout.splitlines()[-1])["cases"] > 1  # goes on behind it
