"""Training on a tiny capture: it learns, resumes, and refuses the checkpoints and captures of others."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import new_avatar
from livehand.backend.avatars.file import load_avatar
from livehand.backend.evaluation.perceptual.vgg import PerceptualLoss
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.training.checkpoint import TrainState, checkpoint_path, load_checkpoint
from livehand.backend.training.config import LossConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.parts import Correction, TrainedParts, optimiser_of
from livehand.backend.training.processes import ComputeSetup
from safetensors import safe_open

SHORT = TrainConfig(steps=60, warmup_steps=5, checkpoint_every=20, learning_rate=1e-2, plane_learning_rate=3e-2)


@pytest.fixture
def output(tmp_path):
    return tmp_path / "a.safetensors"


@pytest.fixture
def run(setup, output, compute, silent):
    """A function that trains the small setup, or one that differs from it, and returns the avatar."""

    def run(config=SHORT, output=output, compute=compute, resume=False, **changes):
        return train(replace(setup, **changes), config, output, compute, silent, resume).avatar

    return run


@pytest.fixture
def losses_of(log_of):
    """A function (avatar's path) -> the loss of every step."""
    return lambda output: [entry["loss/total"] for entry in log_of(output)]


def test_it_learns_and_saves_the_result(run, setup, output, losses_of, weights_of):
    avatar, hand = run(), setup.hand
    losses = losses_of(output)
    assert len(losses) == 60
    assert np.mean(losses[-6:]) < 0.62 * np.mean(losses[:6])
    back = load_avatar(output)
    assert (back.name, back.hand_sha256, back.config) == ("a", hand.sha256, setup.avatar_config)
    assert back.provenance["training"]["steps"] == 60
    assert back.provenance["capture"] == setup.capture.provenance
    for key, value in weights_of(avatar).items():
        torch.testing.assert_close(weights_of(back)[key], value.half().float())
    fresh = new_avatar("a", hand.name, hand.sha256, setup.avatar_config)
    assert not torch.equal(avatar.field.planes[0].table, fresh.field.planes[0].table)


def test_half_precision_learns_as_well(run, output, cpu, losses_of):
    run(replace(SHORT, steps=40), compute=ComputeSetup(cpu, "bf16"))
    losses = losses_of(output)
    assert np.mean(losses[-6:]) < 0.7 * np.mean(losses[:6])


class Killed(Exception):
    pass


def test_an_interrupted_run_gives_the_result_of_an_uninterrupted_one(run, output, tmp_path, weights_of):
    steps, is_lethal = [], False

    def begin(views, state):
        steps.append(state.step)
        if is_lethal and state.step == 33:
            raise Killed

    corrections = (Correction("observer", torch.nn.Module(), 0.0, begin),)
    whole = run(output=tmp_path / "whole.safetensors", corrections=corrections)
    steps.clear()
    is_lethal = True
    with pytest.raises(Killed):
        run(corrections=corrections)
    assert checkpoint_path(output).is_file()
    assert not output.exists()
    is_lethal = False
    resumed = run(corrections=corrections, resume=True)
    assert steps == [*range(34), *range(20, 60)]  # from the checkpoint after step 20
    for key, value in weights_of(resumed).items():
        torch.testing.assert_close(value, weights_of(whole)[key], atol=1e-5, rtol=1e-4)


def test_without_resume_it_starts_again(run, output, losses_of):
    config = replace(SHORT, steps=4, checkpoint_every=2)
    first, first_losses = run(config), losses_of(output)
    again, losses = run(config), losses_of(output)
    assert len(losses) == 4
    assert losses == first_losses
    assert torch.equal(first.field.planes[0].table, again.field.planes[0].table)


def test_resuming_a_finished_run_does_no_step(run, output, losses_of):
    config = replace(SHORT, steps=4, checkpoint_every=2)
    run(config)
    before = output.read_bytes()
    run(config, resume=True)
    assert len(losses_of(output)) == 4
    assert output.read_bytes() == before


@pytest.mark.parametrize(
    "other",
    [
        {"config": replace(SHORT, steps=5, checkpoint_every=2)},
        {"config": replace(SHORT, steps=4, checkpoint_every=2, seed=1)},
        {"superres": SuperResConfig(width=4, depth=2)},
    ],
)
def test_a_checkpoint_of_another_run_is_refused(run, small, other):
    config = replace(SHORT, steps=4, checkpoint_every=2)
    run(config)
    avatar_config = replace(small, superres=other.get("superres", small.superres))
    with pytest.raises(LiveHandError, match="must be of the same capture and settings"):
        run(other.get("config", config), avatar_config=avatar_config, resume=True)


def test_damaged_checkpoints_are_refused(run, output):
    config = replace(SHORT, steps=4, checkpoint_every=2)
    run(config)
    path = checkpoint_path(output)
    data = path.read_bytes()
    for damaged in (b"", data[:100], data[:-1], output.read_bytes()):  # the last: a .safetensors of another kind
        path.write_bytes(damaged)
        with pytest.raises(LiveHandError, match=r"a\.checkpoint"):
            run(config, resume=True)


def test_a_checkpoint_holds_the_optimiser_too(run, output):
    config = replace(SHORT, steps=4, checkpoint_every=4)
    avatar = run(config)
    parts = TrainedParts(avatar)
    optimiser = optimiser_of(parts.requires_grad_(), config)
    path = checkpoint_path(output)
    with safe_open(path, framework="pt") as archive:
        identity = archive.metadata()["run"]
    progress = load_checkpoint(path, TrainState(parts, TrainedParts(avatar), optimiser), identity)
    assert (progress.step, progress.skipped) == (4, 0)
    states = [optimiser.state[p] for group in optimiser.param_groups for p in group["params"]]
    assert all(float(state["step"]) == 4 for state in states if state)
    assert sum(bool(state) for state in states) == len(states)
    assert max(float(state["exp_avg"].abs().max()) for state in states) > 0


def test_a_capture_of_another_hand_or_without_views_is_refused(run, painted_capture, output):
    with pytest.raises(LiveHandError, match="must be of hand"):
        run(capture=replace(painted_capture, hand_sha256="0" * 64))
    with pytest.raises(LiveHandError, match="must have training images"):
        run(capture=replace(painted_capture, views=painted_capture.of_split("test")))
    left = HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3), "left")
    with pytest.raises(LiveHandError, match="must all be of the right hand"):
        run(capture=replace(painted_capture, poses=(left, left)))
    assert not output.exists()


class CountingDistance(PerceptualLoss):
    """A perceptual distance without weights that counts its calls."""

    def __init__(self):
        torch.nn.Module.__init__(self)
        self.calls = 0

    def forward(self, ours, truth):
        self.calls += 1
        return (ours - truth).square().mean()


def test_the_last_part_has_the_perceptual_term(run):
    distance, calls = CountingDistance(), []
    observer = Correction("observer", torch.nn.Module(), 0.0, lambda views, state: calls.append(distance.calls))
    config = replace(SHORT, steps=10, loss=LossConfig(perceptual_share=0.3, perceptual_rise=0.0))
    run(config, perceptual=distance, corrections=(observer,))
    assert np.diff([*calls, distance.calls]).tolist() == [0] * 7 + [2] * 3  # two resolutions


def test_the_seed_is_part_of_the_run(run, tmp_path, losses_of):
    outputs = [tmp_path / f"{seed}.safetensors" for seed in (0, 5)]
    for seed, output in zip((0, 5), outputs, strict=True):
        run(replace(SHORT, steps=3, seed=seed), output)
    assert losses_of(outputs[0]) != losses_of(outputs[1])
