"""The hairs of the built-in hand: where they grow, how many, how long, which way."""

import numpy as np
import pytest
from livehand.backend.surface.base_surface import HAIR_FILE, base_arrays
from livehand.backend.surface.detail_mesh import DetailTemplate
from livehand.backend.surface.detail_surface import load_detail_surface
from livehand.backend.surface.hair_growth import REGIONS, HairGround, HairGrowth, grown_hairs
from livehand.tools.builtin_hand.hair_shares import MIDDLE, PROXIMAL, WRIST, hair_shares


@pytest.fixture(scope="module")
def template(hand):
    return DetailTemplate.of(load_detail_surface(hand.sha256), hand)


@pytest.fixture(scope="module")
def growth():
    return HairGrowth(base_arrays(HAIR_FILE)["hair/share"], REGIONS)


def hairs_on(template, growth):
    tensors = template.rest_vertices(), template.normals, template.faces
    return grown_hairs(HairGround(*(values.numpy() for values in tensors)), growth)


def test_the_file_that_ships_is_the_generator_s(hand, template, growth):
    np.testing.assert_array_equal(hair_shares(template, hand), growth.share)


def test_regions_grow_as_dense_as_they_are_told(template, growth):
    half = {name: region._replace(per_m2=region.per_m2 / 2) for name, region in REGIONS.items()}
    none = {name: region._replace(per_m2=0.0) for name, region in REGIONS.items()}
    whole, halved, bare = (
        len(hairs_on(template, growth._replace(regions=regions)).corners) for regions in (REGIONS, half, none)
    )
    assert halved == pytest.approx(whole / 2, rel=0.06)
    assert bare == 0


@pytest.fixture(scope="module")
def grown(template, growth):
    """Hairs, and of each: bone, root, normal, rise and bend, m."""
    hairs = hairs_on(template, growth)
    hit_points, normals = (values.numpy()[hairs.corners] for values in (template.rest_vertices(), template.normals))
    normal = (normals * hairs.weights[..., None]).sum(1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    axes = np.stack([hit_points[:, 1] - hit_points[:, 0], hit_points[:, 2] - hit_points[:, 0], normal], 1)
    rise, bend = ((way[..., None] * axes).sum(1) for way in (hairs.rise, hairs.bend))
    root = (hit_points * hairs.weights[..., None]).sum(1)
    bone = template.bones.of_face.numpy()
    of_corners = {tuple(face): bone[index] for index, face in enumerate(template.faces.numpy().tolist())}
    return hairs, np.array([of_corners[tuple(face)] for face in hairs.corners.tolist()]), root, normal, rise, bend


def test_palm_tips_and_thumb_have_none(grown):
    _, bone, root, normal, _, _ = grown
    assert set(bone) == {WRIST, *PROXIMAL, *MIDDLE}
    on_fingers, on_hand = bone > 0, (bone == WRIST) & (root[:, 0] < 0.08)
    assert normal[on_fingers, 1].min() > 0.3
    assert normal[on_hand, 1].min() > 0.4
    assert all((bone == number).sum() > 8 for number in PROXIMAL)


def test_a_phalanx_has_as_many_as_its_back_has_room_for(grown, hand):
    """Of a back 14 mm wide and half as long as the phalanx."""
    _, bone, _, _, _, _ = grown
    for number in PROXIMAL:
        length_m = np.linalg.norm(hand.joints[number + 1] - hand.joints[number])
        room = REGIONS["proximal"].per_m2 * 0.014 * length_m / 2
        assert (bone == number).sum() == pytest.approx(room, rel=0.35)


def test_the_forearm_has_the_most_and_more_on_its_back(grown):
    _, bone, root, normal, _, _ = grown
    arm = (bone == WRIST) & (root[:, 0] > 0.12)
    assert arm.mean() > 0.6
    assert (normal[arm, 1] > 0.5).sum() > 3 * (normal[arm, 1] < -0.5).sum() > 0


def test_they_leave_the_skin_and_curve_down_to_it(grown):
    _, _, _, normal, rise, bend = grown
    up, down = (rise * normal).sum(1), (bend * normal).sum(1)
    np.testing.assert_allclose(down, -0.75 * up, atol=1e-6)
    sine = up / np.linalg.norm(rise, axis=1)
    assert 0.15 < sine.min() < sine.max() < 0.6
    length_mm = 1000 * np.linalg.norm(rise + bend, axis=1)
    assert 0.8 < length_mm.min() < length_mm.max() < 16


def test_they_point_from_the_body_and_to_the_little_finger(grown):
    _, bone, _, _, rise, _ = grown
    for on in (bone > 0, bone == WRIST):
        mean = rise[on].mean(0) / np.linalg.norm(rise[on], axis=1).mean()
        assert mean[0] < -0.4
        assert mean[2] < -0.3


def test_weights_are_inside_faces_and_evenly_spread(grown):
    weights = grown[0].weights
    np.testing.assert_allclose(weights.sum(1), 1)
    assert weights.min() >= 0
    np.testing.assert_allclose(weights.mean(0), 1 / 3, atol=0.02)


def test_the_first_of_them_are_a_fair_sample_and_always_the_same(grown, growth, template):
    hairs, bone, _, _, _, _ = grown
    quarter = hairs.first(0.25)
    assert len(quarter.corners) == round(0.25 * len(hairs.corners))
    assert (bone[: len(quarter.corners)] == WRIST).mean() == pytest.approx((bone == WRIST).mean(), abs=0.04)
    for first, again in zip(quarter, hairs_on(template, growth), strict=True):
        np.testing.assert_array_equal(first, again[: len(first)])
