"""What training changes: parameter groups, corrections, and the average of the weights."""

from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.avatar import new_avatar
from livehand.backend.field.field import FieldConfig
from livehand.backend.training.checkpoint import checkpoint_path
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.parts import Correction, Rendered, TrainedParts, WeightAverage, optimiser_of, set_rates
from safetensors import safe_open

SHORT = TrainConfig(steps=6, warmup_steps=1, checkpoint_every=3, ema_decay=0.0)


class Gain(torch.nn.Module):
    """A factor for each camera."""

    def __init__(self, count):
        super().__init__()
        self.log_gain = torch.nn.Parameter(torch.zeros(count))

    def forward(self, rendered, source):
        return Rendered(*(image * self.log_gain[source.camera_index].exp() for image in rendered))


def test_planes_have_a_rate_of_their_own(avatar, small):
    others, planes = optimiser_of(TrainedParts(avatar), SHORT).param_groups
    assert {id(p) for p in planes["params"]} == {id(avatar.field.planes[0].table), id(avatar.field.relief.table)}
    assert (others["initial_lr"], planes["initial_lr"]) == (SHORT.learning_rate, SHORT.plane_learning_rate)
    networks = [*avatar.field.parameters(), *avatar.superres.parameters()]
    assert len(others["params"]) + 2 == len(networks)
    paper = new_avatar("a", "hand", "0" * 64, replace(small, field=FieldConfig(kind="paper")))
    assert len(optimiser_of(TrainedParts(paper), SHORT).param_groups) == 1


def test_corrections_have_rates_of_their_own_too(avatar):
    gain, frozen = Gain(3), Gain(2)
    corrections = (Correction("gain", gain, 0.5), Correction("other", frozen, 0.25))
    optimiser = optimiser_of(TrainedParts(avatar, corrections), SHORT, corrections)
    set_rates(optimiser, 0.1)
    rates = {id(p): group["lr"] for group in optimiser.param_groups for p in group["params"]}
    assert rates[id(gain.log_gain)] == pytest.approx(0.05)
    assert rates[id(frozen.log_gain)] == pytest.approx(0.025)
    assert rates[id(avatar.field.planes[0].table)] == pytest.approx(0.1 * SHORT.plane_learning_rate)


def test_corrections_change_the_view_the_image_and_the_loss(setup, compute, tmp_path):
    """A trained gain, a view whose ground truth is made darker, and a penalty."""
    gain, seen, begun = Gain(4), [], []

    def darker(view, source):
        seen.append(source.file)
        return view._replace(target=torch.cat([view.target[:3] * 0.25, view.target[3:]]))

    correction = Correction(
        "gain",
        gain,
        learning_rate=0.05,
        begin=lambda views, state: begun.append((len(views), state.step)),
        before=darker,
        after=gain,
        penalty=lambda: {"gain_l2": gain.log_gain.square().sum() * 1e-3},
    )
    output, reporting = tmp_path / "a.safetensors", ReportConfig(log_every=6, preview_minutes=0.0)
    result = train(replace(setup, corrections=(correction,)), replace(SHORT, steps=12), output, compute, reporting)
    assert begun == [(6, step) for step in range(12)]
    assert sorted(set(seen)) == sorted(view.file for view in setup.capture.of_split("train"))
    assert (gain.log_gain[:3] < -0.05).all()  # as the ground truth is darker than the initial networks
    assert gain.log_gain[3] == 0  # of the held-out camera
    assert "loss/gain_l2" in (tmp_path / "a.log.jsonl").read_text()
    assert result.avatar.provenance["corrections"] == {"gain": {}}
    with safe_open(checkpoint_path(output), framework="pt") as archive:
        torch.testing.assert_close(archive.get_tensor("part.corrections.gain.log_gain"), gain.log_gain.detach())
    with safe_open(output, framework="pt") as archive:
        assert not [key for key in archive.keys() if "gain" in key]


def test_the_average_has_its_closed_form():
    """Weights w_k = k after step k, with decays d_k = min(d, (1+k)/(10+k)): sum of w_k (1-d_k) prod_{j>k} d_j."""
    module = torch.nn.Linear(2, 3).double()
    torch.nn.init.zeros_(module.weight)
    average = WeightAverage(module, 0.8)
    decays = [min(0.8, (1 + k) / (10 + k)) for k in range(60)]
    assert decays[0] == 0.1
    assert decays[-1] == 0.8
    for k in range(60):
        torch.nn.init.constant_(module.weight, k)
        average.update(module, k)
    shares = [(1 - decays[k]) * torch.tensor(decays[k + 1 :], dtype=torch.float64).prod() for k in range(60)]
    expected = sum(k * share for k, share in enumerate(shares))
    constant = torch.full((3, 2), float(expected), dtype=torch.float64)
    torch.testing.assert_close(average.module.weight, constant, rtol=1e-12, atol=0)
    assert not average.module.weight.requires_grad


def test_without_decay_the_average_is_the_last_step():
    module = torch.nn.BatchNorm1d(4)
    average = WeightAverage(module, 0.0)
    for step in range(3):
        torch.nn.init.normal_(module.weight)
        module.running_mean += 1
        average.update(module, step)
    assert torch.equal(average.module.weight, module.weight)
    assert torch.equal(average.module.running_mean, torch.full((4,), 3.0))
