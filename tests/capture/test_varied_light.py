"""Lights drawn at random: their kinds, strengths, places and groups by value."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.varied_light import (
    BRIGHTNESS,
    GROUPS,
    HELD_OUT_KINDS,
    LightDrawing,
    box_triangles,
    brightness_of,
    light_groups,
    sky_brightness,
)
from livehand.backend.records.light import Lamp, Light, Sky, sky_directions

CAMERA = np.array([0.6, -0.8, 0])
HAND_M = 0.147  # the reach of the built-in hand's poses


def drawn(kind, seed):
    return LightDrawing(np.random.default_rng(seed), CAMERA).light(kind)


def towards(lamp):
    return -lamp.direction if lamp.kind == "sun" else lamp.position / np.linalg.norm(lamp.position)


@pytest.mark.parametrize("kind", ["soft", "hard", "mixed", "key", "rim", "block"])
def test_the_parts_add_up_to_the_brightness_of_all_lights(kind):
    totals = []
    for seed in range(8):
        light = drawn(kind, seed).light
        totals.append(sky_brightness(light.sky) + sum(map(brightness_of, light.lamps)))
    assert 0.5 * BRIGHTNESS < min(totals)
    assert max(totals) < 2 * BRIGHTNESS
    assert np.mean(totals) == pytest.approx(BRIGHTNESS, rel=0.2)


def test_brightness_by_closed_forms():
    white = np.ones(3)
    assert brightness_of(Lamp("sun", 3 * white)) == pytest.approx(3 / np.pi)
    lamp = Lamp("point", 5 * white, np.array([0, 0, 0.5]))
    assert brightness_of(lamp) == pytest.approx(5 / (4 * np.pi * 0.25) / np.pi)
    assert brightness_of(replace(lamp, kind="area")) == pytest.approx(5 / (np.pi * 0.25) / np.pi)
    assert sky_brightness(Sky(np.ones((32, 64, 3)))) == pytest.approx(1, rel=0.01)
    half = (sky_directions(32, 64)[..., :1] > 0) * np.ones(3)
    assert sky_brightness(Sky(half)) == pytest.approx(1, rel=0.02)


@pytest.mark.parametrize("seed", range(6))
def test_the_kinds_are_what_they_are_called(seed):
    assert drawn("soft", seed).light.lamps == ()
    for kind, low, high in (("key", 0.15, 0.9), ("block", 0.15, 0.9), ("rim", -0.9, -0.3)):
        light = drawn(kind, seed).light
        (lamp,) = light.lamps
        assert low <= towards(lamp) @ CAMERA <= high
        assert brightness_of(lamp) > 5 * sky_brightness(light.sky)
        assert (lamp.kind == "sun") or kind == "rim"
        assert len(light.occluders) == (24 if kind == "block" else 0)
    (hard,) = drawn("hard", seed).light.lamps
    assert max(hard.angle_rad, hard.radius_m) < 0.081
    assert 1 <= len(drawn("mixed", seed).light.lamps) <= 3
    assert {drawn(kind, seed).kind for kind in HELD_OUT_KINDS} == set(HELD_OUT_KINDS)


def test_lamps_stand_all_around_and_shine_at_the_hand():
    lamps = [lamp for seed in range(25) for lamp in drawn("mixed", seed).light.lamps]
    assert np.linalg.norm(np.mean([towards(lamp) for lamp in lamps], 0)) < 0.35
    for lamp in lamps:
        if lamp.kind != "sun":
            assert 0.34 < np.linalg.norm(lamp.position) < 2.01
        if lamp.kind == "area":
            assert lamp.direction @ -towards(lamp) > 0.97


@pytest.mark.parametrize("seed", range(5))
def test_the_block_hides_half_of_the_hand_and_touches_it_nowhere(seed):
    block = drawn("block", seed)
    sun = towards(block.light.lamps[0])
    points = np.random.default_rng(1).normal(size=(400, 3))
    share = np.random.default_rng(2).uniform(size=(400, 1)) ** (1 / 3)
    points *= HAND_M * share / np.linalg.norm(points, axis=1)[:, None]
    slab, wall = block.light.occluders[:12], block.light.occluders[12:]
    assert 0.15 < np.mean([meets(point, sun, slab) for point in points]) < 0.85
    assert np.mean([meets(point, sun, wall) for point in points]) < 0.02
    for part in (slab, wall):
        normal = np.cross(*(part[0, 1:] - part[0, :1]))
        assert np.linalg.norm(normal) > 0
        samples = np.random.default_rng(3).dirichlet(np.ones(3), 300) @ part
        assert np.linalg.norm(samples, axis=-1).min() > HAND_M
    assert np.ptp(block.light.occluder_albedo[:12]) == 0


@pytest.mark.parametrize("seed", range(5))
def test_no_arm_goes_through_a_block(seed):
    """One that reaches through slab and wall moves them out along their normals; one beside them moves nothing."""
    plain = drawn("block", seed)
    slab, wall = plain.light.occluders[:12], plain.light.occluders[12:]
    arm = np.concatenate([np.linspace(0, 1, 131)[:, None] * 1.3 * part.mean((0, 1)) for part in (slab, wall)])
    both = replaced(seed, arm).occluders
    for part, before in ((both[:12], slab), (both[12:], wall)):
        area = np.cross(before[:, 1] - before[:, 0], before[:, 2] - before[:, 0])
        widest = area[np.linalg.norm(area, axis=1).argmax()]
        out = widest / np.linalg.norm(widest) * np.sign(widest @ before.mean((0, 1)))
        moved_m = (part - before) @ out
        np.testing.assert_allclose(part - before, moved_m[..., None] * out, atol=1e-9)
        assert np.ptp(moved_m) < 1e-9
        assert moved_m.min() > 0.02
    assert not any(is_inside(point, part) for point in arm for part in (both[:12], both[12:]))
    assert any(is_inside(point, part) for point in arm for part in (slab, wall))
    beside = replaced(seed, np.array([[9.0, 9, 9]])).occluders
    np.testing.assert_array_equal(beside, plain.light.occluders)


def is_inside(point, triangles):
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    return bool((((point - triangles[:, 0]) * normals).sum(1) < 0).all())


def replaced(seed, skin_m):
    return LightDrawing(np.random.default_rng(seed), CAMERA, skin_m=skin_m).light("block").light


def meets(origin, direction, triangles):
    """Whether a ray meets any of the triangles (Moeller and Trumbore)."""
    for a, b, c in triangles:
        try:
            u, v, distance = np.linalg.solve(np.stack([b - a, c - a, -direction], 1), origin - a)
        except np.linalg.LinAlgError:
            continue
        if u >= 0 and v >= 0 and u + v <= 1 and distance > 0:
            return True
    return False


def test_groups_add_up_to_the_light():
    for seed in range(10):
        whole = drawn("mixed", seed)
        groups = light_groups(whole)
        assert len(groups) == min(len(whole.light.lamps), 2) + 1
        assert sum((group.light.lamps for group in groups), ()) == whole.light.lamps
        assert [group.light.sky is not None for group in groups] == [True] + [False] * (len(groups) - 1)
        assert len(groups[1].light.lamps) == 1
        assert [group.light.groups for group in groups] == [(name,) for name in GROUPS[: len(groups)]]


def test_training_lights_are_mixed_and_reproducible():
    drawing = LightDrawing(np.random.default_rng(0), CAMERA)
    kinds = [drawing.training_kind() for _ in range(2000)]
    shares = {kind: kinds.count(kind) / 2000 for kind in set(kinds)}
    assert shares == pytest.approx({"dome": 0.08, "soft": 0.28, "hard": 0.18, "mixed": 0.46}, abs=0.03)
    one, other = (LightDrawing(np.random.default_rng(5), CAMERA).training_light(True) for _ in range(2))
    np.testing.assert_array_equal(one.light.occluders, other.light.occluders)
    assert len(one.light.occluders) == (0 if one.kind == "dome" else 12)


def test_a_box_is_closed():
    triangles = box_triangles(np.array([1.0, 2, 3]), np.eye(3), np.array([0.1, 0.2, 0.3]))
    areas = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]) / 2
    np.testing.assert_allclose(areas.sum(0), 0, atol=1e-12)
    assert np.linalg.norm(areas, axis=1).sum() == pytest.approx(8 * (0.02 + 0.03 + 0.06))
    volume = np.einsum("ti,ti->", triangles.mean(1), areas) / 3
    assert volume == pytest.approx(8 * 0.1 * 0.2 * 0.3)  # above 0: normals point outwards
    assert Light(occluders=triangles).occluders.shape == (12, 3, 3)
