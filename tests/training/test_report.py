"""What training reports: the log, TensorBoard, and the preview of held-out views."""

import re
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.capture.capture import SurfaceReference
from livehand.backend.capture.person import Person
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.renderer import Renderer
from livehand.backend.surface.base_surface import surface_of_person
from livehand.backend.surface.surface_file import surface_sha256, write_surface
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.metric_writers import JsonLinesLog, TensorBoardLog
from livehand.backend.training.preview import HeldOutPreview, _spread_order
from livehand.backend.training.report import TrainingReport, preview_path
from livehand.backend.training.schedule import Clock, Interval, Schedule
from livehand.backend.training.step import StepResult
from livehand.tests.builders import scores_of
from PIL import Image

CPU = torch.device("cpu")
SILENT = ReportConfig(preview_minutes=0.0, log_every=4)


@pytest.fixture
def now():
    """The time of a clock that is moved by hand: now[0]."""
    return [100.0]


@pytest.fixture
def report_of(painted_capture, hand, tmp_path):
    def report(config, train_config, clock, first_step=0):
        preview = HeldOutPreview(painted_capture, hand, CPU, config.preview_views)
        return TrainingReport(config, Schedule(train_config), clock, preview, tmp_path / "a.safetensors", first_step)

    return report


@pytest.fixture
def lines(log_of):
    return lambda folder: log_of(folder / "a.safetensors")


def test_the_log_holds_means_pace_and_remaining_time(report_of, tmp_path, now, avatar, lines):
    config = TrainConfig(steps=20, warmup_steps=1)
    clock = Clock(50.0, lambda: now[0])
    with report_of(SILENT, config, clock, first_step=8) as report:
        for step in range(8, 14):
            now[0] += 3
            clock.waiting_s += 0.75
            faulty = ("bad.png",) if step == 10 else ()
            terms = {"colour": float(step), "total": 2.0 * step if step != 10 else np.nan}
            report.step(Schedule(config).at(step), StepResult(terms, faulty), lambda: avatar)
        report.finish(14, avatar)
    first, last = lines(tmp_path)
    rate = Schedule(config).at(11).rate_factor
    assert first == {
        "step": 12,
        "loss/colour": pytest.approx((8 + 9 + 11) / 3, rel=1e-5),
        "loss/total": pytest.approx(2 * (8 + 9 + 11) / 3, rel=1e-5),
        "rate": pytest.approx(rate, rel=1e-5),
        "time/total_s": 62,
        "time/step_s": 3,
        "time/eta_s": 24,
        "time/data_wait_share": 0.25,
        "skipped": 1,
    }
    assert (last["step"], last["loss/colour"]) == (14, 12.5)


def test_where_no_bar_is_seen_there_is_a_line_every_20_seconds(report_of, now, avatar, capsys):
    config = TrainConfig(steps=10, warmup_steps=1)
    with report_of(SILENT, config, Clock(now=lambda: now[0])) as report:
        for step in range(6):
            now[0] += 9
            report.step(Schedule(config).at(step), StepResult({"total": 0.5}, ()), lambda: avatar)
    lines = [line for line in re.split(r"[\r\n]+", capsys.readouterr().err) if line.startswith("step ")]
    assert lines == [
        "step 3, 30%, loss 0.5000, about 1.1 minutes left",
        "step 6, 60%, loss 0.5000, about 0.6 minutes left",
    ]


def test_a_resumed_log_drops_the_steps_that_will_be_repeated(tmp_path, lines):
    path = tmp_path / "a.log.jsonl"
    path.write_text('{"step": 4, "x": 1.0}\n{"step": 8, "x": 2.0}\n{"step": 12, "x": 3.0}\n{"step": 16, "x"')
    log = JsonLinesLog(path, 8)
    log.write_scalars(12, {"x": 1 / 3})
    log.close()
    assert lines(tmp_path) == [{"step": 4, "x": 1}, {"step": 8, "x": 2}, {"step": 12, "x": 0.333333}]
    JsonLinesLog(path, 0).close()
    assert path.read_text() == ""


def test_previews_come_by_the_clock_and_show_what_evaluation_measures(
    report_of, painted_capture, hand, avatar, tmp_path, now, lines
):
    config, schedule = TrainConfig(steps=20), Schedule(TrainConfig(steps=20))
    result = StepResult({"total": 1.0}, ())
    path = preview_path(tmp_path / "a.safetensors")
    with report_of(ReportConfig(preview_minutes=2.0), config, Clock(now=lambda: now[0])) as report:
        now[0] += 119
        report.step(schedule.at(0), result, lambda: avatar)
        assert not path.exists()
        now[0] += 1
        report.step(schedule.at(1), result, lambda: avatar)
        assert path.exists()
        report.step(schedule.at(2), result, pytest.fail)
    scores = scores_of(Renderer(avatar, hand, "cpu"), painted_capture, painted_capture.of_split("test"))
    held_out = [line for line in lines(tmp_path) if "held_out/psnr_full" in line]
    assert [line["step"] for line in held_out] == [2]
    for name in ("psnr_full", "psnr_hand"):
        expected = np.mean([score.figures[name] for score in scores])
        assert held_out[0][f"held_out/{name}"] == pytest.approx(expected, rel=1e-5)
        assert report.held_out[name] == pytest.approx(expected)
    with Image.open(path) as sheet:
        assert sheet.size == (24 * 12, 32)  # room for four views of three tiles each, two used
        assert np.asarray(sheet)[:, 24 * 6 :].max() == 0
        assert np.asarray(sheet)[:, 24 * 3 : 24 * 4].max() > 100
    assert not list(tmp_path.glob(".*partial*"))


def test_a_preview_takes_the_first_split_that_shows_the_hand(painted_capture, hand, avatar):
    only_training = replace(painted_capture, views=painted_capture.of_split("train"))
    assert HeldOutPreview(only_training, hand, CPU, 4).render(avatar).sheet.shape == (32, 24 * 12, 3)
    assert len(HeldOutPreview(only_training, hand, CPU, 4)._views) == 4
    assert len(HeldOutPreview(painted_capture, hand, CPU, 4)._views) == 2
    nothing = replace(painted_capture, views=())
    assert HeldOutPreview(nothing, hand, CPU, 4).render(avatar) is None


@pytest.mark.parametrize("count", [1, 5, 40, 97])
def test_the_first_views_of_a_preview_are_spread_evenly(count):
    order = _spread_order(count)
    assert sorted(order) == list(range(count))
    if count >= 40:
        hit_points = sorted(order[:8])
        assert max(np.diff([-1, *hit_points, count])) <= count // 3


def test_a_session_without_output_is_silent(painted_capture, hand, avatar, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    schedule = Schedule(TrainConfig(steps=2))
    preview = HeldOutPreview(painted_capture, hand, CPU, 2)
    with TrainingReport(ReportConfig(preview_minutes=1e-9), schedule, Clock(), preview, None, 0) as report:
        report.step(schedule.at(0), StepResult({"total": 1.0}, ("bad.png",)), lambda: avatar)
        report.finish(1, avatar)
    assert not list(tmp_path.iterdir())
    assert capsys.readouterr() == ("", "")


def test_the_end_of_training_is_previewed_with_the_average(setup, compute, painted_capture, hand, tmp_path, capsys):
    output = tmp_path / "a.safetensors"
    result = train(setup, TrainConfig(steps=4, warmup_steps=1), output, compute, ReportConfig())
    scores = scores_of(Renderer(load_avatar(output), hand, "cpu"), painted_capture, painted_capture.of_split("test"))
    expected = np.mean([score.figures["psnr_full"] for score in scores])
    assert result.held_out["psnr_full"] == pytest.approx(expected, abs=0.01)  # the file's half precision
    assert 0 <= result.data_wait_share < 1
    assert "step 4: held-out PSNR" in capsys.readouterr().err


def test_previews_show_the_skin_of_the_capture(setup, compute, tmp_path, monkeypatch):
    """Without the avatar's surface, previews are of the coarse mesh, by 10 dB worse."""
    surface, seen = surface_of_person(Person(melanin=0.3), setup.hand.sha256), []
    write_surface(tmp_path / "surface.npz", surface)
    reference = SurfaceReference(str(tmp_path / "surface.npz"), surface_sha256(surface))
    shown = replace(setup, capture=replace(setup.capture, surface=reference))
    monkeypatch.setattr(HeldOutPreview, "render", lambda _self, avatar: seen.append(avatar.surface))
    often = ReportConfig(preview_minutes=1e-9, log_every=1)
    train(shown, TrainConfig(steps=2, warmup_steps=1), tmp_path / "a.safetensors", compute, often)
    assert seen == [surface] * 3
    assert load_avatar(tmp_path / "a.safetensors").surface == surface


def test_previews_do_not_change_the_result(setup, compute, tmp_path, lines, weights_of):
    config = TrainConfig(steps=6, warmup_steps=1)
    often = ReportConfig(preview_minutes=1e-9, preview_views=1, log_every=1)
    with_previews, without = (
        train(setup, config, tmp_path / f"{name}.safetensors", compute, reporting)
        for name, reporting in (("a", often), ("b", SILENT))
    )
    assert len([line for line in lines(tmp_path) if "held_out/psnr_full" in line]) == 7  # one more at the end
    assert without.held_out == {}
    for key, value in weights_of(with_previews.avatar).items():
        assert torch.equal(value, weights_of(without.avatar)[key])


def test_recurring_actions_are_due_after_their_interval(now):
    clock = Clock(now=lambda: now[0])
    every, never = Interval(10.0, clock), Interval(0.0, clock)
    due = []
    for now[0] in (105.0, 110.0, 111.0, 119.0, 120.5, 129.0, 131.0):
        due.append(every.is_due())
        assert not never.is_due()
    assert due == [False, True, False, False, True, False, True]


def test_tensorboard_holds_metrics_and_previews(setup, compute, tmp_path, lines):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    board = tmp_path / "board"
    reporting = ReportConfig(log_every=4, tensorboard=board)
    train(setup, TrainConfig(steps=8, warmup_steps=1), tmp_path / "a.safetensors", compute, reporting)
    events = EventAccumulator(str(board)).Reload()
    logged = {line["step"]: line for line in lines(tmp_path) if "rate" in line}
    for name in ("loss/total", "rate", "time/data_wait_share"):
        assert [event.step for event in events.Scalars(name)] == [4, 8]
        for event in events.Scalars(name):
            assert event.value == pytest.approx(logged[event.step][name], rel=1e-4)
    assert [event.step for event in events.Scalars("held_out/psnr_hand")] == [8]
    (image,) = events.Images("held_out/preview")
    assert (image.width, image.height) == (24 * 12, 32)


def test_a_resumed_tensorboard_hides_the_steps_that_are_repeated(tmp_path):
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    for first_step, steps, value in ((0, (4, 8, 12, 16), 1.0), (8, (12, 16), 2.0)):
        board = TensorBoardLog(tmp_path, first_step)
        for step in steps:
            board.write_scalars(step, {"x": value})
        board.close()
    events = EventAccumulator(str(tmp_path)).Reload().Scalars("x")
    assert [(event.step, event.value) for event in events] == [(4, 1), (8, 1), (12, 2), (16, 2)]


def test_a_missing_tensorboard_is_reported(setup, compute, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch.utils.tensorboard", None)
    reporting = ReportConfig(tensorboard=tmp_path / "board")
    with pytest.raises(LiveHandError, match=r'pip install "livehand\[tensorboard\]"'):
        train(setup, TrainConfig(steps=8), tmp_path / "a", compute, reporting)
