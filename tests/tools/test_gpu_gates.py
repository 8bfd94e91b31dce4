"""The gates of a GPU: what counts as held, and what is said where there is none."""

import sys

import pytest
import torch
from livehand.backend.records.errors import LiveHandError
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


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU")
def test_without_a_gpu_it_says_so(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["gpu_gates"])
    with pytest.raises(LiveHandError, match="NVIDIA GPU, got none"):
        gpu_gates.main()
