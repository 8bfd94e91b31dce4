"""Sampled lamps against closed forms of the irradiance."""

from math import pi

import numpy as np
import pytest
import torch
from livehand.backend.light.lamp_samples import LampSamples
from livehand.backend.light.shadow_maps import FAR, Bounds
from livehand.backend.records.light import Lamp

BOUNDS = Bounds(torch.zeros(3), torch.tensor(0.1))
DOWN = np.eye(3)  # a lamp's own axes: it shines along -Z
UP = torch.tensor([0.0, 0, 1])


def irradiance(lamp, point=(0.0, 0, 0), normal=UP):
    """RGB irradiance at a point without any shadow."""
    samples = LampSamples.of((lamp,), BOUNDS)
    towards, strength = samples.arriving(torch.tensor([point]))
    cosine = (towards[:, 0] * normal).sum(-1).clamp(min=0)
    return pi * (strength[:, 0] * cosine).sum() * samples.rgb[0]


def test_a_sun_has_its_irradiance_and_a_point_falls_off_with_the_square():
    sun = Lamp("sun", np.array([1.0, 2, 3]), angle_rad=0.01)
    torch.testing.assert_close(irradiance(sun), torch.tensor([1.0, 2, 3]))
    point = Lamp("point", np.array([10.0, 0, 0]), np.array([0, 0, 2.0]))
    assert float(irradiance(point)[0]) == pytest.approx(10 / (4 * pi * 4))
    assert float(irradiance(point, (0.0, 0, 1))[0]) == pytest.approx(10 / (4 * pi))


def test_a_small_area_lamp_is_lambertian():
    lamp = Lamp("area", np.array([1.0, 1, 1]), np.array([0, 0, 1.5]), DOWN, size_m=(1e-4, 1e-4))
    assert float(irradiance(lamp)[0]) == pytest.approx(1 / (pi * 1.5**2), rel=1e-4)
    cosine = 1.5 / np.hypot(1.5, 1)
    assert float(irradiance(lamp, (1.0, 0, 0))[0]) == pytest.approx(cosine**2 / (pi * (1.5**2 + 1)), rel=1e-4)
    assert float(irradiance(lamp, (0.0, 0, 3))[0]) == 0  # behind it


def test_a_large_disc_is_integrated():
    """Irradiance on the axis of a Lambertian disc of radius r at height h: pi L r^2 / (r^2 + h^2)."""
    radius, height = 0.3, 0.5
    lamp = Lamp("area", np.ones(3), np.array([0, 0, height]), DOWN, size_m=(2 * radius, 2 * radius), is_ellipse=True)
    expected = 1 / (pi * (radius**2 + height**2))
    assert float(irradiance(lamp)[0]) == pytest.approx(expected, rel=0.01)


@pytest.mark.slow
def test_a_beam_of_limited_spread_keeps_its_power():
    lamp = Lamp("area", np.ones(3), np.array([0, 0, 1.0]), DOWN, size_m=(1e-4, 1e-4), spread_rad=1.0)
    radius = np.linspace(0, np.tan(0.5) * 1.05, 4001)
    values = [float(irradiance(lamp, (float(r), 0.0, 0.0))[0]) for r in radius[::20]]
    power = np.trapz(np.array(values) * 2 * pi * radius[::20], radius[::20])
    assert power == pytest.approx(1, rel=0.01)


def test_a_spot_is_a_point_within_its_cone():
    lamp = Lamp("spot", np.ones(3), np.array([0, 0, 1.0]), DOWN, cone_rad=1.0, blend=0.2)
    assert float(irradiance(lamp)[0]) == pytest.approx(1 / (4 * pi))
    assert float(irradiance(lamp, (float(np.tan(0.51)), 0, 0))[0]) == 0
    # Half way through the soft edge, in cosines, the smooth step is a half.
    along = np.cos(0.5) + 0.5 * (1 - np.cos(0.5)) * 0.2
    edge = float(irradiance(lamp, (float(np.tan(np.arccos(along))), 0.0, 0.0))[0])
    assert edge == pytest.approx(0.5 * along**3 / (4 * pi), rel=1e-3)


def test_lamps_of_all_sizes_have_samples_that_add_up():
    for size_m, count in ((0.01, 1), (0.1, 4), (0.3, 9), (0.6, 16)):
        lamp = Lamp("area", np.ones(3), np.array([0, 0, 1.0]), DOWN, size_m=(size_m, size_m))
        samples = LampSamples.of((lamp, lamp), BOUNDS)
        assert len(samples.lamp) == 2 * count
        assert samples.share.sum() == pytest.approx(2 / pi, rel=1e-5)
        assert float(samples.radius_rad[0]) == pytest.approx(np.arctan(size_m / 2))


def test_views_look_from_the_lamp():
    lamps = (Lamp("point", np.ones(3), np.array([0, 0.3, 0])), Lamp("sun", np.ones(3)))
    views = LampSamples.of(lamps, BOUNDS).views(BOUNDS)
    torch.testing.assert_close(views.frames[:, 2], torch.tensor([[0.0, 1, 0], [0, 0, 1]]))
    torch.testing.assert_close(views.distance, torch.tensor([3.0, FAR]))


@pytest.mark.parametrize("shadow_quality", ["coarse", "fine"])
@pytest.mark.parametrize(("size_m", "fewest"), [(0.08, 3), (0.2, 8), (0.9, 15)])
def test_an_edge_hides_the_points_of_a_square_lamp_one_after_the_other(size_m, fewest, shadow_quality):
    """Along both sides; the points lie evenly: the mean is the lamp's centre, without correlation."""
    lamp = Lamp("area", np.ones(3), np.array([0, 0, 1.0]), DOWN, size_m=(size_m, size_m))
    at = LampSamples.of((lamp,), BOUNDS, shadow_quality).position[:, :2].double() / size_m
    assert len(at) > fewest * (1 + (shadow_quality == "fine"))
    for axis in range(2):
        assert np.diff(np.sort(at[:, axis].numpy())) == pytest.approx(1 / len(at), rel=1e-3)
    assert at.mean(0).abs().max() < 1e-6
    assert abs(float((at[:, 0] * at[:, 1]).mean())) < 1e-6


def test_in_kept_frames_a_hard_suns_penumbra_has_small_steps():
    """An edge far before the hand hides the sun's points one after the other, whichever way it runs."""
    sun = Lamp("sun", np.ones(3), angle_rad=np.deg2rad(2.5))
    steps = {}
    for shadow_quality in ("coarse", "fine"):
        towards = LampSamples.of((sun,), BOUNDS, shadow_quality).position[:, :2].double()
        turns = torch.arange(16) * np.pi / 16
        hidden_at = (towards @ torch.stack([turns.cos(), turns.sin()]).double()).sort(0).values
        steps[shadow_quality] = float(hidden_at.diff(dim=0).max()) / sun.angle_rad
    assert steps["fine"] < 0.3 < 0.4 < steps["coarse"]
