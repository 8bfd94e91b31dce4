"""What is kept of a light: what is found anew where anything is another, and the same tensors where nothing is."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.light.kept_samples import KeptPatches, KeptSamples
from livehand.backend.light.nearby_geometry import Patches
from livehand.backend.light.samples import LightSamples
from livehand.backend.light.shadow_maps import Bounds
from livehand.backend.records.light import Lamp, Light, Sky

AREA = Lamp("area", np.array([3.0, 2, 1]), np.array([0.0, -0.6, 0.4]), size_m=(0.3, 0.2))
SUN = Lamp("sun", np.array([1.0, 2, 3]), angle_rad=0.02)
POINT = Lamp("point", np.array([1.0, 1, 1]), np.array([0.3, 0.2, 0.5]), radius_m=0.05)
SKY = Sky(np.abs(np.random.default_rng(0).normal(1, 0.5, (8, 16, 3))))
LIGHT = Light((AREA, SUN), SKY)


def at(x_m):
    return Bounds(torch.tensor([x_m, 0.0, 0.0]), torch.tensor(0.1))


def tensors_of(value):
    return [one for part in value for one in (tensors_of(part) if isinstance(part, tuple) else [part])]


def assert_same(one, other):
    for ours, theirs in zip(tensors_of(one), tensors_of(other), strict=True):
        assert torch.equal(ours, theirs)


OTHERS = {
    "the same": LIGHT,
    "another sky": replace(LIGHT, sky=Sky(2 * SKY.radiance)),
    "no sky": replace(LIGHT, sky=None),
    "another lamp": replace(LIGHT, lamps=(AREA, replace(SUN, rgb=np.array([5.0, 5, 5])))),
    "a lamp elsewhere": replace(LIGHT, lamps=(replace(AREA, position=np.array([0.5, 0, 0])), SUN)),
    "a lamp without shadows": replace(LIGHT, lamps=(AREA, replace(SUN, casts_shadow=False))),
    "fewer lamps": replace(LIGHT, lamps=(AREA,)),
    "no lamps": replace(LIGHT, lamps=()),
    "a lamp that faces the hand": replace(LIGHT, lamps=(AREA, POINT)),
    "finer shadows": replace(LIGHT, shadow_quality="fine"),
}


@pytest.mark.parametrize("x_m", [0.0, 0.05, 2.0])  # at 2 m the area lamp has fewer samples
@pytest.mark.parametrize("name", OTHERS)
def test_after_another_light_samples_are_those_of_the_light_alone(name, x_m):
    kept = KeptSamples()
    for light, place in ((LIGHT, 0.0), (OTHERS[name], x_m), (LIGHT, 0.0)):
        assert_same(kept.samples(light, at(place)), LightSamples.of(light, at(place)))


def test_a_light_that_stays_keeps_its_tensors_and_only_angles_change():
    kept = KeptSamples()
    first = kept.samples(LIGHT, at(0.0))
    again = kept.samples(Light((replace(AREA), replace(SUN)), Sky(SKY.radiance.copy())), at(0.05))
    assert again.sky is first.sky
    assert again.lamps.position is first.lamps.position
    assert not torch.equal(again.lamps.radius_rad, first.lamps.radius_rad)


def test_a_sky_and_a_lamp_that_are_written_in_place_are_others():
    light = Light((replace(AREA, rgb=AREA.rgb.copy()),), Sky(SKY.radiance.copy()))
    kept = KeptSamples()
    kept.samples(light, at(0.0))
    light.sky.radiance[:] *= 3
    light.lamps[0].rgb[:] = 7.0
    assert_same(kept.samples(light, at(0.0)), LightSamples.of(light, at(0.0)))


def test_patches_are_found_anew_where_hand_or_geometry_are_others():
    kept, hand = KeptPatches(), torch.as_tensor(np.random.default_rng(0).normal(0, 0.05, (64, 3)), dtype=torch.float32)
    wall = np.array([[[-0.3, -0.3, -0.2], [0.3, -0.3, -0.2], [0.0, 0.3, -0.2]]])
    light = Light(lamps=(SUN,), occluders=wall.copy(), occluder_albedo=np.full((1, 3), 0.5))
    first = kept.around(light, hand)
    assert kept.around(replace(light, lamps=(AREA,)), hand.clone()) is first
    for other, there in ((light, hand + 0.01), (replace(light, occluder_albedo=np.full((1, 3), 0.6)), hand)):
        assert_same(kept.around(other, there), Patches.around(other, there))
    light.occluders[:] += 0.02  # in place
    assert_same(kept.around(light, hand), Patches.around(light, hand))
    assert kept.around(replace(light, occluder_albedo=np.zeros((0, 3))), hand) is None
