"""Planes carried over to another atlas: the same features at the same places of the surface."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.relightable import RelightableField
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training import setup as transfer
from livehand.backend.training.setup import transfer_planes

CONFIG = FieldConfig(planes=((48, 3, 2), (64, 1, 4)), relief=32, light="linear")


@pytest.fixture(autouse=True)
def few_samples(monkeypatch):
    monkeypatch.setattr(transfer, "_SAMPLES", 60_000)


@pytest.fixture
def theirs():
    """A field whose planes are smooth functions of the atlas."""
    field = RelightableField(CONFIG)
    with torch.no_grad():
        for plane in (*field.feature_planes, field.relief):
            centre = (torch.arange(plane.resolution) + 0.5) / plane.resolution
            v, u = torch.meshgrid(centre, centre, indexing="ij")
            layer = torch.arange(plane.heights)[:, None]
            channel = torch.arange(plane.channels)
            value = (2 * u[..., None, None] - v[..., None, None] + 0.3 * layer) * (channel + 1)
            plane.table.copy_(value.reshape(-1, plane.channels))
    return field


def turned(hand):
    """The same surface with its atlas on its side, and another file."""
    return replace(hand, vt=np.stack([1 - hand.vt[:, 1], hand.vt[:, 0]], 1), sha256="1" * 64)


def at_places(field, hand, plane_index):
    """Features of a plane in the middle of each large face."""
    uv = hand.vt[hand.ft].mean(1)
    plane = (*field.feature_planes, field.relief)[plane_index]
    height = torch.zeros(len(uv))
    return plane(torch.as_tensor(uv, dtype=torch.float32), height, torch.ones(len(uv))).detach()


@pytest.mark.parametrize("plane_index", [0, 1, 2])
def test_the_same_place_has_the_same_features_in_another_atlas(hand, theirs, plane_index):
    ours, other = RelightableField(CONFIG), turned(hand)
    transfer_planes(ours, other, theirs, hand)
    expected, got = at_places(theirs, hand, plane_index), at_places(ours, other, plane_index)
    spread = float(expected.std())
    assert float((got - expected).abs().median()) < 0.03 * spread
    before = at_places(theirs, other, plane_index)  # the planes without the transfer
    assert float((before - expected).abs().median()) > 0.3 * spread


def test_no_texel_is_left_as_it_was(hand, theirs):
    ours = RelightableField(CONFIG)
    with torch.no_grad():
        ours.planes[0].table.fill_(777.0)
    transfer_planes(ours, turned(hand), theirs, hand)
    assert float(ours.planes[0].table.detach().max()) < 100


def test_a_hand_elsewhere_is_refused(hand, theirs):
    away = replace(hand, v_template=hand.v_template + 0.05)
    with pytest.raises(LiveHandError, match=r"must lie over .* mm away"):
        transfer_planes(RelightableField(CONFIG), away, theirs, hand)


def test_other_planes_are_refused(hand, theirs):
    ours = RelightableField(replace(CONFIG, planes=((48, 2, 2), (64, 1, 4))))
    with pytest.raises(LiveHandError, match="equal configurations"):
        transfer_planes(ours, turned(hand), theirs, hand)
