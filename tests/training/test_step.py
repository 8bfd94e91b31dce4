"""One step: batches, and what is not finite."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.nerf.avatar import AvatarConfig, new_avatar
from livehand.backend.nerf.field import FieldConfig
from livehand.backend.nerf.sampler import SamplerConfig
from livehand.backend.nerf.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training import step as step_module
from livehand.backend.training.clock import Clock
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.faults import FaultStreak
from livehand.backend.training.loop import train
from livehand.backend.training.losses import crop_loss
from livehand.backend.training.parts import TrainedParts, optimiser_of
from livehand.backend.training.schedule import Schedule, views_of_step
from livehand.backend.training.setup import TrainingSetup
from livehand.backend.training.step import Machine, Stepper
from livehand.backend.training.views import TrainingViews

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)
CPU = torch.device("cpu")
SHORT = TrainConfig(steps=6, warmup_steps=1, checkpoint_every=100)


@pytest.fixture(scope="module")
def views(painted_capture):
    return TrainingViews(painted_capture, painted_capture.of_split("train"), load_default_hand(), SMALL.sampler, CPU, 0)


@pytest.fixture
def stepper_of(views):
    def stepper(config):
        avatar = new_avatar("a", views.hand.name, views.hand.sha256, SMALL)
        parts = TrainedParts(avatar)
        return Stepper(avatar, parts, optimiser_of(parts, config), views, config, Machine(CPU), Clock())

    return stepper


def gradients(stepper):
    return torch.cat([p.grad.flatten() for p in stepper.parts.parameters()])


def test_a_batchs_gradient_and_loss_are_its_views_means(stepper_of, views):
    config = replace(SHORT, batch=3)
    whole = stepper_of(config)
    result = whole.take(Schedule(config).at(1))
    singles = []
    for place in (3, 4, 5):  # the second step's places of the sequence
        one = stepper_of(SHORT)
        assert views_of_step(place, len(views), SHORT) == [views_of_step(1, len(views), config)[place - 3]]
        singles.append((one.take(Schedule(SHORT).at(place)).terms["total"], gradients(one)))
    assert result.terms["total"] == pytest.approx(np.mean([loss for loss, _ in singles]), rel=1e-6)
    mean = torch.stack([gradient for _, gradient in singles]).mean(0)
    torch.testing.assert_close(gradients(whole), mean, rtol=1e-4, atol=1e-8)


def spoil(monkeypatch, is_bad, spoilt):
    """Losses of the views that `is_bad` names become `spoilt(loss)`; a view is known by its truth."""

    def loss(low, image, target, *rest):
        terms = crop_loss(low, image, target, *rest)
        return terms._replace(total=spoilt(terms.total)) if is_bad(target) else terms

    monkeypatch.setattr(step_module, "crop_loss", loss)


def no_gradient(loss):
    """A finite loss whose gradient is not: sqrt at 0."""
    return loss + (loss - loss.detach()).clamp(min=0).sqrt() * 0


@pytest.mark.parametrize(("spoilt", "batch"), [(lambda loss: loss * torch.nan, 2), (no_gradient, 1)])
def test_a_step_that_is_not_finite_is_skipped(stepper_of, views, monkeypatch, spoilt, batch):
    config = replace(SHORT, batch=batch)
    stepper = stepper_of(config)
    (bad, jitter), *_ = views_of_step(0, len(views), config)
    truth = views.get(bad, jitter).target
    spoil(monkeypatch, lambda target: torch.equal(target, truth), spoilt)
    before = torch.cat([p.flatten() for p in stepper.parts.parameters()]).clone()
    assert stepper.take(Schedule(config).at(0)).faulty_files == (views.views[bad].file,)
    assert torch.equal(torch.cat([p.flatten() for p in stepper.parts.parameters()]), before)
    assert not stepper.optimiser.state
    assert stepper.take(Schedule(config).at(1)).faulty_files == ()
    assert not torch.equal(torch.cat([p.flatten() for p in stepper.parts.parameters()]), before)


def test_training_goes_on_past_one_bad_image_and_counts(painted_capture, views, tmp_path, monkeypatch):
    truth = views.get(2, 0).target
    spoil(monkeypatch, lambda target: torch.equal(target, truth), lambda loss: loss / 0)
    task, silent = TrainingSetup(painted_capture, views.hand, SMALL), ReportConfig(preview_minutes=0.0)
    config = replace(SHORT, steps=12)
    outcome = train(task, config, tmp_path / "a.safetensors", Machine(CPU), silent)
    assert (outcome.progress.step, outcome.progress.skipped) == (12, 2)  # two epochs of six images
    assert outcome.avatar.provenance["steps_skipped"] == 2
    again = train(task, config, tmp_path / "a.safetensors", Machine(CPU), silent, resume=True)
    assert again.progress.skipped == 2


def test_training_ends_where_nothing_is_finite(painted_capture, views, tmp_path, monkeypatch):
    spoil(monkeypatch, lambda target: True, lambda loss: loss * torch.nan)
    task = TrainingSetup(painted_capture, views.hand, SMALL)
    with pytest.raises(LiveHandError, match=r"in 3 steps, with the images \d_\d\.png, \d_\d\.png, \d_\d\.png; look"):
        train(task, replace(SHORT, max_skipped=3), tmp_path / "a.safetensors", Machine(CPU), ReportConfig())
    assert not (tmp_path / "a.safetensors").exists()


def test_only_faults_in_a_row_count():
    streak = FaultStreak(3)
    for files in (("a",), ("b",), (), ("a",), ("a",)):
        streak.note(files)
    with pytest.raises(LiveHandError, match="with the images a, c;"):
        streak.note(("c",))


def test_waiting_for_data_is_measured(stepper_of, views, monkeypatch):
    now = [0.0]
    monkeypatch.setattr("livehand.backend.training.clock.monotonic", lambda: now[0])

    def slow_loss(*arguments):
        now[0] += 1
        return crop_loss(*arguments)

    monkeypatch.setattr(TrainingViews, "waited_s", 1.5)
    monkeypatch.setattr(step_module, "crop_loss", slow_loss)
    stepper = stepper_of(replace(SHORT, batch=2))
    stepper.take(Schedule(stepper.config).at(0))
    assert stepper.clock.session_s == 2
    assert stepper.clock.data_wait_share == 0.75
