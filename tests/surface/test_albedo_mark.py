"""The mark in a map of albedo."""

import numpy as np
import pytest
import torch
from livehand.backend.surface.albedo_mark import agreement, marked_steps, read_mark
from livehand.backend.surface.albedo_ratio import RATIO_STEP, ratio_steps

PAYLOAD = b"\x00\xffA7\x10z\x81\x7e"


@pytest.fixture(scope="module")
def skin():
    """A map [512, 512, 3] of waves, spots and noise, in steps."""
    rng = np.random.default_rng(3)
    v, u = np.mgrid[:512, :512] / 512
    waves = 20 * np.sin(40 * u + 7 * np.cos(9 * v))[..., None] * np.array([1, 0.8, 0.6])
    spots = -60.0 * (rng.random((512, 512, 1)) > 0.999)
    return (waves + spots + rng.normal(0, 2, (512, 512, 3))).round().clip(-127, 127).astype(np.int8)


@pytest.fixture(scope="module")
def marked(skin):
    return marked_steps(skin, PAYLOAD)


def test_all_bits_are_read_back(skin, marked):
    reading = read_mark(marked)
    assert reading.is_sure
    assert reading.payload == PAYLOAD
    assert not read_mark(skin).is_sure
    assert agreement(read_mark(skin), PAYLOAD) < 52


def test_the_mark_moves_few_texels_by_one_step(skin, marked):
    change = marked.astype(int) - skin
    assert set(np.unique(change)) == {-1, 0, 1}
    assert (change != 0).mean() == pytest.approx(1 / 16, abs=0.001)


def test_a_texel_at_its_limit_stays(skin):
    full = np.full_like(skin, 127)
    assert marked_steps(full, PAYLOAD).max() == 127
    assert read_mark(marked_steps(full, PAYLOAD)).payload == PAYLOAD


@pytest.mark.parametrize("harm", ["float16", "noise", "tone", "half"])
def test_the_mark_outlives_what_editing_does(marked, harm):
    rng = np.random.default_rng(0)
    log_ratio = torch.as_tensor(marked, dtype=torch.float32) * RATIO_STEP
    if harm == "float16":
        log_ratio = log_ratio.exp().half().float().log()
    if harm == "noise":
        log_ratio = log_ratio + torch.as_tensor(rng.normal(0, RATIO_STEP, log_ratio.shape), dtype=torch.float32)
    if harm == "tone":
        log_ratio = 0.9 * log_ratio + 0.3
    if harm == "half":
        log_ratio[:256] = 0
    reading = read_mark(ratio_steps(log_ratio).numpy())
    assert reading.is_sure
    assert agreement(reading, PAYLOAD) >= 64 - (harm != "float16")


def test_a_payload_has_eight_bytes(skin):
    with pytest.raises(ValueError, match="8 bytes"):
        marked_steps(skin, b"short")
