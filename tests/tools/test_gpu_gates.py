"""The gates of a GPU: what counts as held, and what is said where there is none."""

import sys

import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.renderer import Renderer
from livehand.tools import gpu_gates
from livehand.tools.gpu_gates import GpuGate, median_ms, moving_shots


def test_frames_that_warm_up_are_not_timed(monkeypatch):
    now, rendered = [0.0], []

    def render(shot):
        rendered.append(shot)
        now[0] += 5.0 if len(rendered) <= 4 else 0.001 * len(rendered)

    monkeypatch.setattr(gpu_gates.time, "perf_counter", lambda: now[0])
    assert median_ms(render, list(range(5))) == pytest.approx(7.0)  # of the 5th to the 9th
    assert rendered == [0, 1, 2, 3, 0, 1, 2, 3, 4]


def test_a_line_says_what_was_asked_and_whether_it_holds():
    assert str(GpuGate("a frame", "at most 1.5 ms", "1.60 ms", False)) == "FAILS  a frame: 1.60 ms (at most 1.5 ms)"
    assert str(GpuGate("a frame", "at most 1.5 ms", "1.40 ms", True)).startswith("holds  a frame")


def test_shots_have_three_lamps_and_a_sky_and_move():
    first, second = moving_shots((64, 96), 2)
    assert len(first.light.lamps) == 3
    assert first.light.sky is not None
    assert abs(first.vertices - second.vertices).max() > 1e-3


@pytest.mark.slow
def test_a_rehearsal_runs_all_of_it_on_the_cpu(capsys, monkeypatch):
    """So that no silly fault is found on the day when there is a GPU."""
    pytest.importorskip("warp")
    monkeypatch.setattr(gpu_gates, "gate_of_tests", lambda tests: GpuGate("tests", "pass", str(tests), True))
    assert gpu_gates.main(["--rehearse", "--frames", "1"]) == 0
    first, tests, frame, paper = capsys.readouterr().out.splitlines()
    assert "rehearsal" in first
    assert "test_backend.py" in tests
    assert frame.startswith("holds  frame of 64x96, Shot to Frame: ")
    assert "the paper as published" in paper


def test_a_frame_that_stages_would_render_is_not_timed(monkeypatch):
    renderer = Renderer(load_avatar(), load_default_hand(), "cpu", "fp32", ReferenceBackend())
    with pytest.raises(LiveHandError, match="rendered at once"):
        gpu_gates.at_once(renderer, moving_shots((64, 96), 1)[0])


def test_tests_that_fail_or_take_too_long_hold_no_gate(monkeypatch, tmp_path):
    (tmp_path / "test_one.py").write_text("def test_one():\n    assert False\n")
    assert not gpu_gates.gate_of_tests((str(tmp_path / "test_one.py"),)).holds


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_it_says_so(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["gpu_gates"])
    with pytest.raises(LiveHandError, match="NVIDIA GPU with CUDA's torch, got none"):
        gpu_gates.main()
