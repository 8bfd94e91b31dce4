"""A painted skin of another model on the built-in hand's atlas, and back."""

import numpy as np
import pytest
import torch
from livehand.backend.person.atlas_transfer import AtlasTransfer
from livehand.backend.rigs.model_transfer.model_transfer import ModelTransfer
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.tests.mano_twin import write_twin

pytestmark = pytest.mark.slow
SIZE = 256
AMPLITUDE, WAVES = 0.4, np.array([[150.0, 20, 60], [30, 170, -80], [60, 40, 140]])
SPOT_M, FARTHEST_SPOT_M = 0.0008, 0.003  # how far a spot lands from where it was: mean, and of 19 in 20


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    return write_twin(tmp_path_factory.mktemp("twin") / "mano_twin.npz")


@pytest.fixture(scope="module")
def transfer(hand, twin):
    return ModelTransfer.of(hand, twin.model)


def colours(points):
    return (0.5 + AMPLITUDE * np.sin(points @ WAVES)).astype(np.float32)


def texels(model):
    corner_uv = torch.as_tensor(model.vt[model.ft], dtype=torch.float32)
    return AtlasTexels.of(corner_uv, torch.as_tensor(model.f), SIZE)


@pytest.fixture(scope="module")
def painted(twin):
    """The twin's texture, black beyond its charts."""
    own = texels(twin.model)
    image = np.zeros((SIZE * SIZE, 3), np.float32)
    image[own.pixel] = colours(own.at_texels(twin.model.v_template))
    return image.reshape(SIZE, SIZE, 3)


def test_colours_lie_on_the_same_skin(hand, twin, transfer, painted):
    carrying = AtlasTransfer.to_ours(transfer, SIZE)
    ours = texels(hand)
    truth = colours(ours.at_texels(twin.surface))
    shown = carrying.coverage.ravel()[ours.pixel]
    off = np.abs(ours.from_map(carrying.carried(painted)) - truth)[shown]
    # A wave's slope is its amplitude times its number times a cosine, whose mean is 2 / pi, along the way it was moved.
    slope = AMPLITUDE * np.linalg.norm(WAVES, axis=0).mean() * 2 / np.pi
    assert off.mean() < slope * SPOT_M
    assert np.quantile(off, 0.95) < slope * FARTHEST_SPOT_M
    assert np.abs(truth - truth.mean(0)).mean() > 0.2  # what no transfer would be off by
    is_hand = ours.at_texels((hand.arm_weights == 0)[:, None].astype(float))[:, 0] > 0.99
    assert shown[is_hand].mean() > 0.94
    assert shown[ours.at_texels(hand.arm_weights[:, None])[:, 0] > 0.99].mean() < 0.02


def test_back_it_is_what_it_was(twin, transfer, painted):
    there, back = AtlasTransfer.to_ours(transfer, SIZE), AtlasTransfer.to_other(transfer, SIZE)
    returned = back.carried(there.carried(painted))
    own, shown = texels(twin.model), back.coverage.ravel()
    off = np.abs(own.from_map(returned) - own.from_map(painted))[shown[own.pixel]]
    assert off.mean() < 0.01
    assert shown[own.pixel].mean() > 0.9
