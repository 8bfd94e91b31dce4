"""What lamps and sky are together."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.light.samples import LightSamples
from livehand.backend.light.shadow_maps import Bounds
from livehand.backend.records.light import Lamp, Light, Sky

BOUNDS = Bounds(torch.zeros(3), torch.tensor(0.1))
DOWN = np.eye(3)  # a lamp's own axes: it shines along -Z


def test_no_lamps_are_no_samples():
    samples = LightSamples.of(Light(), BOUNDS)
    assert len(samples.lamps.lamp) == len(samples.lamps.rgb) == 0
    assert samples.sky.flux.abs().sum() == 0
    towards, strength = samples.lamps.arriving(torch.zeros(5, 3))
    assert towards.shape == (0, 5, 3)
    assert strength.shape == (0, 5)


def test_all_of_a_light_is_what_a_white_surface_that_faced_it_would_reflect():
    light = Light((Lamp("sun", np.array([3.0, 6, 9])), Lamp("point", np.array([8.0, 0, 0]), np.array([0, 0, 2.0]))))
    of_lamps = (6 + 8 / (4 * pi * 4) / 3) / pi
    assert float(LightSamples.of(light, BOUNDS).unblocked(torch.zeros(3))) == pytest.approx(of_lamps)
    even = Sky(np.full((8, 16, 3), 0.5))  # a sphere of radiance 0.5: 4 times what falls on one side of a plane
    assert float(LightSamples.of(Light(sky=even), BOUNDS).unblocked(torch.zeros(3))) == pytest.approx(2.0, rel=1e-3)


def test_frames_that_are_kept_ask_for_more_points_and_what_moves_for_one():
    lamp = Lamp("area", np.ones(3), np.array([0, 0, 1.0]), DOWN, size_m=(0.3, 0.3))
    lights = [Light((lamp,), shadow_quality=shadow_quality) for shadow_quality in ("none", "coarse", "fine")]
    samples = [LightSamples.of(light, BOUNDS).lamps for light in lights]
    assert [len(lamps.lamp) for lamps in samples] == [1, 9, 25]
    assert samples[0].position.tolist() == [[0, 0, 1]]
    arriving = [float(lamps.arriving(torch.zeros(1, 3))[1].sum()) for lamps in samples]
    assert arriving == pytest.approx([arriving[-1]] * 3, rel=0.05)
