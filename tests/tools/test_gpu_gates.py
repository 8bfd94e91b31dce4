"""The gates of a GPU: what counts as held, what outlives what, and what is said where there is none."""

import json
import subprocess
import sys

import pytest
import torch
from livehand.backend.records.errors import LiveHandError
from livehand.tools import gpu_gates
from livehand.tools.gpu_gate_jobs import GpuGate, Machine

REHEARSED = Machine.rehearsed()


def test_a_line_says_what_was_asked_and_whether_it_holds():
    assert str(GpuGate("a frame", "at most 1.5 ms", "1.60 ms", False)) == "FAILS  a frame: 1.60 ms (at most 1.5 ms)"
    assert str(GpuGate("a frame", "at most 1.5 ms", "1.40 ms", True)).startswith("holds  a frame")


def test_tests_that_fail_or_take_too_long_hold_no_gate(monkeypatch, tmp_path):
    (tmp_path / "test_one.py").write_text("def test_one():\n    assert False\n")
    assert not gpu_gates.gate_of_tests(REHEARSED._replace(is_rehearsal=False), [str(tmp_path / "test_one.py")]).holds


@pytest.fixture
def children(monkeypatch):
    """Processes of jobs, replaced by what each writes and how it ends."""
    said = {
        "first": ([GpuGate("a first frame", "at most 2 s", "1 s", True)], 0),
        "batch": ([GpuGate("a batch", "at least 60", "40", False)], 0),
        "training": ([], -11),
        "4k": ([GpuGate("a frame", "at most 12 ms", "9 ms", True)], None),
    }

    def run(command, **named):
        gates, code = said[command[command.index("--job") + 1]]
        text = "".join(json.dumps(gate._asdict()) + "\nnoise\n" for gate in gates)
        if code is None:
            raise subprocess.TimeoutExpired(command, named["timeout"], output=text.encode())
        return subprocess.CompletedProcess(command, code, stdout=text)

    monkeypatch.setattr(gpu_gates.subprocess, "run", run)


@pytest.mark.usefixtures("children")
def test_a_job_that_crashes_or_hangs_fails_alone_and_what_was_measured_is_kept(tmp_path, capsys):
    path = tmp_path / "new" / "gates.json"
    given = ["--rehearse", "--json", str(path), "--only", "training", "4k", "first"]
    assert gpu_gates.main(given) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[1:] == [
        "FAILS  training: ended with exit code -11 (ends)",
        "holds  a frame: 9 ms (at most 12 ms)",
        "FAILS  4k: not done after 240 s (ends)",
        "holds  a first frame: 1 s (at most 2 s)",
    ]
    kept = json.loads(path.read_text())
    assert [gate["holds"] for gate in kept["gates"]] == [False, True, False, True]
    assert "rehearsal" in kept["machine"]


@pytest.mark.usefixtures("children")
def test_a_gate_that_does_not_hold_fails_except_in_a_rehearsal(tmp_path, monkeypatch):
    given = ["--json", str(tmp_path / "gates.json"), "--only", "batch"]
    assert gpu_gates.main([*given, "--rehearse"]) == 0
    monkeypatch.setattr(Machine, "found", lambda: REHEARSED)
    assert gpu_gates.main(given) == 1


@pytest.mark.usefixtures("children")
def test_what_there_is_no_time_for_is_said(tmp_path, capsys):
    assert (
        gpu_gates.main(["--json", str(tmp_path / "gates.json"), "--only", "first", "--minutes", "0", "--rehearse"]) == 1
    )
    assert "FAILS  first: not begun, as 0 minutes are over (ends)" in capsys.readouterr().out


def test_most_waits_end_within_what_a_machine_is_lent_for():
    assert all(30 <= seconds <= 200 for _, seconds in gpu_gates.JOBS.values())  # `--minutes` ends all of them


def test_a_file_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(LiveHandError, match="must be writable"):
        gpu_gates._keep(tmp_path / "file" / "gates.json", REHEARSED, [], 1.0)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_it_says_so(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["gpu_gates"])
    with pytest.raises(LiveHandError, match="NVIDIA GPU with CUDA's torch, got none"):
        gpu_gates.main()
