"""What the gates of a GPU measure: each runs on the CPU, which tells that it runs on the day when there is a GPU."""

import pytest
from livehand.backend.avatars.file import load_avatar
from livehand.backend.capture.capture import load_capture
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.renderer import Renderer
from livehand.tools import gpu_gate_jobs as jobs
from livehand.tools.gpu_gate_jobs import Machine, median_ms, moving_shots, painted_capture
from livehand.tools.gpu_gates import JOBS

REHEARSED = Machine.rehearsed()


def test_frames_that_warm_up_are_not_timed(monkeypatch):
    now, rendered = [0.0], []

    def render(shot):
        rendered.append(shot)
        now[0] += 5.0 if len(rendered) <= 4 else 0.001 * len(rendered)

    monkeypatch.setattr(jobs.time, "perf_counter", lambda: now[0])
    assert median_ms(render, list(range(5))) == pytest.approx(7.0)  # of the 5th to the 9th
    assert rendered == [0, 1, 2, 3, 0, 1, 2, 3, 4]


def test_shots_have_three_lamps_and_a_sky_and_move():
    first, second = moving_shots((64, 96), 2)
    assert len(first.light.lamps) == 3
    assert first.light.sky is not None
    assert abs(first.vertices - second.vertices).max() > 1e-3


def test_a_frame_that_stages_would_render_is_not_timed():
    renderer = Renderer(load_avatar(), load_default_hand(), "cpu", "fp32", ReferenceBackend())
    with pytest.raises(LiveHandError, match="rendered at once"):
        jobs.at_once(renderer, moving_shots((64, 96), 1)[0])


@pytest.mark.nightly
def test_what_is_trained_on_is_a_lit_capture_with_a_surface(tmp_path):
    painted_capture(tmp_path, (64, 96))
    capture = load_capture(tmp_path)
    assert capture.is_lit
    assert capture.surface is not None
    assert all(view.is_linear for view in capture.views)


@pytest.mark.slow
@pytest.mark.parametrize(
    "name",
    ["first", *(pytest.param(name, marks=pytest.mark.nightly) for name in ("small", "1080p", "batch", "training"))],
)
def test_a_job_runs_on_the_cpu(name):
    pytest.importorskip("warp")
    gates = JOBS[name][0](REHEARSED, 1)
    assert gates
    assert all(any(digit.isdigit() for digit in gate.measured) for gate in gates)
