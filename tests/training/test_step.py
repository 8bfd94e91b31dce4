"""One step of training: batches, faults and waiting."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import new_avatar
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.parts import Correction, Rendered, TrainedParts, optimiser_of
from livehand.backend.training.schedule import Clock, Schedule, views_of_step
from livehand.backend.training.step import SkippedSteps, Stepper
from livehand.backend.training.views import TrainingViews

SHORT = TrainConfig(steps=6, warmup_steps=1, checkpoint_every=100)


@pytest.fixture
def stepper_of(views, compute, small):
    def stepper(config, clock=None, **corrected):
        avatar = new_avatar("a", views.hand.name, views.hand.sha256, small)
        parts = TrainedParts(avatar)
        return Stepper(
            avatar, parts, optimiser_of(parts, config), views, config, compute, clock or Clock(), **corrected
        )

    return stepper


def gradients(stepper):
    return torch.cat([p.grad.flatten() for p in stepper.parts.parameters()])


def test_a_batchs_gradient_and_loss_are_its_views_means(stepper_of, views):
    config = replace(SHORT, batch=3)
    whole = stepper_of(config)
    result = whole.train_step(Schedule(config).at(1))
    singles = []
    for place in (3, 4, 5):  # the second step's places of the sequence
        one = stepper_of(SHORT)
        assert views_of_step(place, len(views), SHORT) == [views_of_step(1, len(views), config)[place - 3]]
        singles.append((one.train_step(Schedule(SHORT).at(place)).terms["total"], gradients(one)))
    assert result.terms["total"] == pytest.approx(np.mean([loss for loss, _ in singles]), rel=1e-6)
    mean = torch.stack([gradient for _, gradient in singles]).mean(0)
    torch.testing.assert_close(gradients(whole), mean, rtol=1e-4, atol=1e-8)


def spoiling(files, spoil):
    """A correction that spoils the rendered images of some files."""

    def after(rendered, source):
        return Rendered(rendered.low, spoil(rendered.image)) if source.file in files else rendered

    return (Correction("spoiling", torch.nn.Module(), 0.0, after=after),)


def not_a_number(image):
    return image * torch.nan


def no_gradient(image):
    """A finite image whose gradient is not finite: the square root at 0."""
    return image + (image - image.detach()).clamp(min=0).sqrt() * 0


@pytest.mark.parametrize(("spoil", "batch"), [(not_a_number, 2), (no_gradient, 1)])
def test_a_step_that_is_not_finite_is_skipped(stepper_of, views, spoil, batch):
    config = replace(SHORT, batch=batch)
    (bad, _), *_ = views_of_step(0, len(views), config)
    stepper = stepper_of(config, corrections=spoiling([views.views[bad].file], spoil))
    before = torch.cat([p.flatten() for p in stepper.parts.parameters()]).clone()
    assert stepper.train_step(Schedule(config).at(0)).faulty_files == (views.views[bad].file,)
    assert torch.equal(torch.cat([p.flatten() for p in stepper.parts.parameters()]), before)
    assert not stepper.optimiser.state
    assert stepper.train_step(Schedule(config).at(1)).faulty_files == ()
    assert not torch.equal(torch.cat([p.flatten() for p in stepper.parts.parameters()]), before)


def test_training_continues_past_one_bad_image_and_counts(setup, views, compute, tmp_path):
    setup = replace(setup, corrections=spoiling([views.views[2].file], lambda image: image / 0))
    config, silent = replace(SHORT, steps=12), ReportConfig(preview_minutes=0.0)
    result = train(setup, config, tmp_path / "a.safetensors", compute, silent)
    assert (result.progress.step, result.progress.skipped) == (12, 2)  # two epochs of six images
    assert result.avatar.provenance["steps_skipped"] == 2
    again = train(setup, config, tmp_path / "a.safetensors", compute, silent, resume=True)
    assert again.progress.skipped == 2


def test_training_stops_if_nothing_is_finite(setup, compute, tmp_path):
    files = [view.file for view in setup.capture.views]
    setup = replace(setup, corrections=spoiling(files, not_a_number))
    with pytest.raises(LiveHandError, match=r"in 3 steps, with the images \d_\d\.png, \d_\d\.png, \d_\d\.png; look"):
        train(setup, replace(SHORT, max_skipped=3), tmp_path / "a.safetensors", compute, ReportConfig())
    assert not (tmp_path / "a.safetensors").exists()


def test_only_successive_skipped_steps_count():
    skipped = SkippedSteps(3)
    for files in (("a",), ("b",), (), ("a",), ("a",)):
        skipped.update(files)
    with pytest.raises(LiveHandError, match="with the images a, c;"):
        skipped.update(("c",))


def test_waiting_for_data_is_measured(stepper_of, monkeypatch):
    now = [0.0]

    def slow(rendered, source):
        now[0] += 1
        return rendered

    monkeypatch.setattr(TrainingViews, "waited_s", 1.5)
    corrections = (Correction("slow", torch.nn.Module(), 0.0, after=slow),)
    stepper = stepper_of(replace(SHORT, batch=2), Clock(now=lambda: now[0]), corrections=corrections)
    stepper.train_step(Schedule(stepper.config).at(0))
    assert stepper.clock.session_s == 2
    assert stepper.clock.data_wait_share == 0.75
