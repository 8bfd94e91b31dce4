"""Rough relighting: the capture's own light changes nothing, twice as much doubles, and a lamp lights its side."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import load_avatar
from livehand.backend.capture.dome import dome_sky
from livehand.backend.field.field import FieldConfig
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.light import Lamp, Light, Sky
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.render.rough_light import baked_light

pytestmark = pytest.mark.slow

SIZE = (66, 88)


def dome_light(factor=1.0):
    return Light(sky=Sky(factor * dome_sky().radiance))


@pytest.fixture(scope="module")
def baked_avatar(hand):
    config = AvatarConfig(FieldConfig(width=8, planes=((16, 1, 4),), relief=8), SuperResConfig(width=4, depth=1))
    made = new_avatar("a", hand.name, hand.sha256, config)
    return replace(made, provenance={"capture": {"made_by": "livehand capture"}})


@pytest.fixture(scope="module")
def renderer(hand, baked_avatar):
    return Renderer(baked_avatar, hand, "cpu", has_rough_light=True)


@pytest.fixture(scope="module")
def shot(hand):
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), -hand.joints[4])
    K = np.array([[210.0, 0, 33], [0, 210, 44], [0, 0, 1]])
    camera = Camera(K, look_at(np.array([0.1, 0.6, 0.2]), np.zeros(3), np.array([1.0, 0, 0])), SIZE)
    return Shot(pose, posed_vertices(hand, pose), camera)


def test_the_captures_own_light_changes_nothing(renderer, shot):
    plain, own = renderer.render(shot), renderer.render(replace(shot, light=dome_light()))
    assert np.abs(own.rgb - plain.rgb).max() < 1e-4
    assert not plain.is_lit
    assert own.is_lit


def test_brighter_light_is_brighter_without_bound(renderer, shot):
    plain, bright = renderer.render(shot), renderer.render(replace(shot, light=dome_light(20.0)))
    covered = plain.alpha > 0.9
    assert bright.rgb[covered] == pytest.approx(20 * plain.rgb[covered], rel=1e-3)


def test_a_lamp_lights_its_own_side(renderer, shot):
    right = shot.camera.cam2world[:3, 0]
    back = np.stack([-shot.camera.cam2world[:3, 2], shot.camera.cam2world[:3, 1]])
    columns = []
    for towards in (right, -right):
        rotation = np.stack([*back, towards], 1)
        rotation[:, 0] *= np.sign(np.linalg.det(rotation))
        frame = renderer.render(replace(shot, light=Light((Lamp("sun", np.ones(3), rotation=rotation),))))
        columns.append((frame.rgb.sum((0, 2)) * np.arange(SIZE[0])).sum() / frame.rgb.sum())
    assert columns[0] > columns[1] + 2


def test_nothing_changes_unless_asked_for_or_where_the_light_is_not_known(hand, baked_avatar, shot):
    lit = replace(shot, light=dome_light(3.0))
    plain = Renderer(baked_avatar, hand, "cpu")
    assert np.array_equal(plain.render(lit).rgb, plain.render(shot).rgb)
    photographed = replace(baked_avatar, provenance={"capture": {"made_by": "livehand import-interhand"}})
    assert baked_light(photographed) is None
    assert not Renderer(photographed, hand, "cpu", has_rough_light=True).is_relightable


def test_the_first_shipped_avatars_light_is_known():
    avatar = load_avatar()
    assert baked_light(avatar) is not None
