"""The built-in hand's signed distance, its subdivision and its detailed surface."""

from itertools import pairwise

import numpy as np
import pytest
import trimesh
from livehand.backend.hand.model_file import builtin_hand_path
from livehand.backend.records.errors import LiveHandError
from livehand.backend.teacher.anatomy import BONES, DIGITS, FINGERS
from livehand.backend.teacher.dependencies import needs
from livehand.backend.teacher.detailed_surface import detailed_surface
from livehand.backend.teacher.frames import build_to_template, swap_distal, template_to_build
from livehand.backend.teacher.loop import neighbour_mean, subdivide
from livehand.backend.teacher.primitives import ball, capsule, ellipsoid, superellipsoid, triangle
from livehand.backend.teacher.projection import project_to_surface
from livehand.backend.teacher.rays import build_rays
from livehand.backend.teacher.sdf import BOUNDS, signed_distance
from livehand.backend.teacher.skin_masks import MASK_NAMES
from scipy.spatial import cKDTree

pytestmark = pytest.mark.slow

COORDINATE_MASKS = {"nailrim", "naily", "tfold", "ridge", "jid"}  # places, not strengths


@pytest.fixture(scope="session")
def hand(hand_without_arm):
    """The hand whose zero set the generator describes: without an arm."""
    return hand_without_arm


@pytest.fixture(scope="module")
def rays():
    return build_rays()


@pytest.fixture(scope="module")
def surface(hand):
    return detailed_surface(hand, levels=2)


def test_primitives_against_closed_forms():
    points = np.random.default_rng(0).normal(size=(200, 3)) * 5
    radius = np.linalg.norm(points, axis=1)
    poles = (np.array([-2.0, 0, 0]), np.array([2.0, 0, 0]))
    np.testing.assert_allclose(ball(points, np.zeros(3), 2.0), radius - 2)
    np.testing.assert_allclose(ellipsoid(points, poles, np.array([0, 1.0, 0]), 2.0, 2.0), radius - 2, atol=1e-7)
    np.testing.assert_allclose(superellipsoid(tuple(points.T / 2), (2.0, 2.0, 2.0), 2.0), radius - 2, atol=1e-7)
    rod = capsule(points, np.array([-1.0, 0, 0]), np.array([1.0, 0, 0]), 0.5, 0.5)
    nearest = np.stack([np.clip(points[:, 0], -1, 1), np.zeros(200), np.zeros(200)], 1)
    np.testing.assert_allclose(rod, np.linalg.norm(points - nearest, axis=1) - 0.5)


def test_triangle_distance_is_trimeshs():
    rng = np.random.default_rng(1)
    points, corners = rng.normal(size=(500, 3)) * 2, rng.normal(size=(3, 3))
    nearest = trimesh.triangles.closest_point(np.repeat(corners[None], 500, 0), points)
    np.testing.assert_allclose(triangle(points, tuple(corners)), np.linalg.norm(points - nearest, axis=1), atol=1e-12)


def test_phalanges_have_their_lengths(rays):
    for digit in DIGITS:
        bones, joints = BONES[digit], rays[digit].joints
        lengths = np.linalg.norm(np.diff(joints, axis=0), axis=1)
        expected = (bones.metacarpal, bones.proximal) if digit == "thumb" else (bones.proximal, bones.middle)
        np.testing.assert_allclose(lengths, expected, rtol=1e-12)
        assert rays[digit].length == pytest.approx(bones.proximal + bones.middle + bones.distal + bones.tip)


def test_ray_coordinates_of_its_own_centreline(rays):
    for ray in rays.values():
        middle = (ray.samples > -ray.metacarpal) & (ray.samples < ray.length - 10)
        points = ray.centre[middle] + 3 * ray.dorsal[middle]
        at = ray.coordinates(points)
        np.testing.assert_allclose(at.along, ray.samples[middle], atol=0.25)
        np.testing.assert_allclose(at.dorsal, 3, atol=0.05)
        np.testing.assert_allclose(at.lateral, 0, atol=0.05)
        assert (at.distance < -1).all()


def test_sign_of_the_distance_at_known_points(rays):
    joints = np.concatenate([ray.joints for ray in rays.values()])
    assert (signed_distance(rays, joints) < -4).all()
    between_fingers = [
        (rays[a].centre[rays[a].nearest_sample(60.0)] + rays[b].centre[rays[b].nearest_sample(60.0)]) / 2
        for a, b in pairwise(FINGERS)
    ]
    outside = np.array([*between_fingers, [60, 40, 0], [60, -50, 0], [-60, 0, 0], [220, 0, 0], [60, 0, 90]])
    assert (signed_distance(rays, outside) > 0.5).all()
    corners = np.array(np.meshgrid(*np.array(BOUNDS).T)).reshape(3, -1).T
    assert (signed_distance(rays, corners) > 0).all()


def test_details_are_small_and_only_on_the_digits(rays, hand):
    points = swap_distal(template_to_build(hand.v_template))
    change = signed_distance(rays, points, True) - signed_distance(rays, points, False)
    assert 0.2 < np.abs(change).max() < 1.5
    assert np.abs(change[points[:, 0] < 0]).max() < 1e-12


def test_template_lies_on_the_zero_set(rays, hand):
    distance = signed_distance(rays, swap_distal(template_to_build(hand.v_template)), with_details=False)
    assert (np.abs(distance) > 1e-6).sum() <= 2  # in a valley between two fingers, where the distance has a kink
    assert np.abs(distance).max() < 0.5
    assert np.abs(distance).mean() < 1e-3


def test_projection_reaches_the_surface_and_keeps_what_is_there(rays, hand):
    vertices = template_to_build(hand.v_template)[::10]
    pushed = vertices + np.random.default_rng(2).normal(size=vertices.shape) * 0.5
    back = project_to_surface(rays, pushed, with_details=False, steps=6)
    assert np.percentile(np.abs(signed_distance(rays, swap_distal(back), False)), 99) < 1e-3
    kept = np.linalg.norm(project_to_surface(rays, vertices, False, 2) - vertices, axis=1)
    assert np.percentile(kept, 99) < 1e-6


def test_frames_round_trip(hand):
    np.testing.assert_allclose(build_to_template(template_to_build(hand.v_template)), hand.v_template, atol=1e-15)
    np.testing.assert_array_equal(swap_distal(swap_distal(hand.v_template)), hand.v_template)


def test_subdivision_keeps_a_regular_plane():
    """On a torus grid of valence 6 everywhere, linear fields stay linear away from the seam."""
    n = 12
    index = np.arange(n * n).reshape(n, n)
    right, up = np.roll(index, -1, 1), np.roll(index, -1, 0)
    both = np.roll(up, -1, 1)
    faces = np.concatenate([np.stack([index, right, both], -1), np.stack([index, both, up], -1)]).reshape(-1, 3)
    plane = np.stack([index % n, index // n], -1).reshape(-1, 2).astype(float)
    fine = subdivide(faces, np.zeros((len(faces), 3, 2)), n * n, 1)
    moved = fine.matrix @ plane
    interior = (plane > 1).all(1) & (plane < n - 2).all(1)
    np.testing.assert_allclose(moved[: n * n][interior], plane[interior], atol=1e-12)
    assert len(fine.faces) == 4 * len(faces)
    np.testing.assert_allclose(fine.matrix.sum(1), 1)


def test_subdivision_of_a_tetrahedron_by_hand():
    corners = np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], dtype=float)
    faces = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
    fine = subdivide(faces, corners[faces][..., :2], 4, 1)
    vertices = fine.matrix @ corners
    # Valence 3: beta = 3/16, so a corner becomes (1 - 9/16) v + 3/16 * (-v); an edge 3/8 (a + b) + 1/8 (c + d).
    np.testing.assert_allclose(vertices[:4], corners * (7 / 16 - 3 / 16))
    np.testing.assert_allclose(vertices[4], (corners[0] + corners[1]) * 3 / 8 + (corners[2] + corners[3]) / 8)
    mesh = trimesh.Trimesh(vertices, fine.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    np.testing.assert_allclose(fine.uv.mean(1).sum(0), (corners[faces][..., :2].mean(1) * 4).sum(0), atol=1e-12)
    np.testing.assert_allclose(neighbour_mean(faces, 4) @ corners, -corners / 3)


def test_detailed_surface_is_a_finer_closed_hand(surface, hand):
    mesh = trimesh.Trimesh(surface.vertices_m, surface.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.euler_number == 2
    assert 3.3e-4 < mesh.volume < 3.7e-4
    assert len(surface.faces) == 16 * len(hand.f)
    assert surface.uv.shape == (len(surface.faces), 3, 2)
    assert surface.uv.min() >= 0
    assert surface.uv.max() <= 1


def test_detailed_surface_inherits_linear_fields(surface, hand):
    np.testing.assert_allclose(surface.subdivision.sum(1), 1)
    np.testing.assert_allclose(surface.lbs_weights.sum(1), 1)
    assert surface.lbs_weights.min() >= 0
    np.testing.assert_allclose(surface.lbs_weights, surface.subdivision @ hand.lbs_weights)
    np.testing.assert_allclose(surface.uv[: len(hand.f)].mean(), hand.vt[hand.ft].mean(), atol=0.01)


def test_detailed_surface_is_close_to_the_template(surface, hand):
    """At three levels, mm: mean 0.54, p99 1.6, max 4.1 off the subdivided template; 0.30, 1.2, 3.5 from its surface."""
    moved = np.linalg.norm(surface.vertices_m - surface.subdivision @ hand.v_template, axis=1) * 1e3
    assert 0.4 < moved.mean() < 0.6
    assert 1.0 < np.percentile(moved, 99) < 1.8
    assert moved.max() < 4.5
    distance = _distances_to_mesh(surface.vertices_m[::5], hand.v_template, hand.f) * 1e3
    assert distance.mean() < 0.35
    assert np.percentile(distance, 99) < 1.4
    assert distance.max() < 3.6


def test_detailed_surface_lies_on_the_detailed_zero_set(rays, surface):
    points = swap_distal(template_to_build(surface.vertices_m))
    distance = np.abs(signed_distance(rays, points, with_details=True))
    assert distance.mean() < 1e-3
    assert np.percentile(distance, 99) < 0.02
    assert distance.max() < 0.4


def test_masks_are_strengths(surface):
    assert tuple(surface.masks) == MASK_NAMES
    for name, mask in surface.masks.items():
        assert mask.shape == (len(surface.vertices_m),)
        assert np.isfinite(mask).all()
        assert mask.min() >= 0 or name in COORDINATE_MASKS
        assert mask.max() <= 1 or name in COORDINATE_MASKS
        assert mask.max() > 0.5 or name == "arm", name
    assert set(np.unique(surface.masks["jid"])) <= {0, *range(1, 13), 14, 15}


def test_masks_lie_where_they_belong(surface):
    points = surface.vertices_m
    palm, nail, tip, vein = (surface.masks[name] > 0.6 for name in ("palm", "nail", "tip", "vein"))
    assert points[vein, 1].min() > points[palm & (points[:, 0] > 0.02), 1].mean()
    assert points[nail, 0].max() < points[:, 0].max() - 0.1
    assert not (nail & palm).any()
    with np.load(builtin_hand_path()) as arrays:
        tips = arrays["J"][[3, 6, 9, 12, 15]]
    assert np.linalg.norm(points[tip][:, None] - tips, axis=-1).min(1).max() < 0.032


def test_nails_are_more_curved_across_than_their_digits(surface, rays):
    points = swap_distal(template_to_build(surface.vertices_m))
    for order, digit in enumerate(DIGITS):
        of_nail = (surface.masks["nailrim"] < 0.9) & (np.abs(surface.masks["naily"] - 0.5) < 0.2)
        at = rays[digit].coordinates(points[of_nail & (surface.lbs_weights[:, 3 * order + 3] > 0.5)])
        assert len(at.lateral) > 8
        columns = np.stack([np.ones_like(at.lateral), at.lateral, at.along, -0.5 * at.lateral**2], 1)
        radius = 1 / np.linalg.lstsq(columns, at.dorsal, rcond=None)[0][3]
        assert 5.0 < radius < (11.0 if digit == "thumb" else 9.0), digit


def test_skin_beside_a_nail_falls_over_some_edges_of_the_surface(surface):
    """Its height follows the mask between 1.1 and 1.6; within one edge that would be a ledge along the triangles."""
    rim = surface.masks["nailrim"]
    edges = np.concatenate([surface.faces[:, pair] for pair in ((0, 1), (1, 2), (2, 0))])
    near, far = np.sort(rim[edges], axis=1).T
    length_mm = np.linalg.norm(np.diff(surface.vertices_m[edges], axis=1)[:, 0], axis=1) * 1e3
    is_beside = (near > 1.1) & (near < 1.3)
    assert is_beside.sum() > 100
    is_ledge = is_beside & ((far - near) / length_mm > 0.5)
    assert is_ledge.sum() / is_beside.sum() < 0.02


def test_half_moons_lie_at_the_roots_of_nails(surface):
    lunula, rim, along = (surface.masks[name] for name in ("lunula", "nailrim", "naily"))
    assert rim[lunula > 0.05].max() < 1.1
    assert along[lunula > 0.05].max() < 0.3
    thumb, pinky = surface.lbs_weights[:, 15] > 0.5, surface.lbs_weights[:, 9] > 0.5
    assert lunula[thumb].max() > 0.9
    assert 0 < lunula[pinky].max() < 0.2


def test_ridges_are_evenly_spaced_on_the_pads(surface):
    pads = (surface.masks["palm"] > 0.9) & (surface.masks["tip"] > 0.2)
    edges = surface.faces[pads[surface.faces].all(1)][:, [0, 1]]
    rise = np.diff(surface.masks["ridge"][edges], axis=1)[:, 0]
    length_mm = np.linalg.norm(np.diff(surface.vertices_m[edges], axis=1)[:, 0], axis=1) * 1e3
    assert (np.abs(rise) <= 1.05 * length_mm).mean() > 0.99


def test_only_the_built_in_right_hand_has_a_detailed_surface(hand):
    with pytest.raises(LiveHandError, match="left hand"):
        detailed_surface(hand.for_side("left"))


def test_the_error_for_a_missing_package_names_the_command():
    with pytest.raises(LiveHandError, match="pip install"), needs("scipy"):
        raise ImportError("No module named 'scipy'")


def _distances_to_mesh(points, vertices, faces, candidates=40):
    """Distance to the nearest of the faces with the nearest centroids."""
    triangles = vertices[faces]
    _, near = cKDTree(triangles.mean(1)).query(points, k=candidates)
    flat = np.repeat(points, candidates, 0)
    closest = trimesh.triangles.closest_point(triangles[near.ravel()], flat)
    return np.linalg.norm(closest - flat, axis=1).reshape(-1, candidates).min(1)


def test_veins_of_a_person_s_own_are_carried_to_the_surface(surface, hand):
    across = surface.vertices_m[:, 2]
    none = np.zeros(len(across))
    worn = surface.worn(hand, across, 2 * across, 3 * across)
    assert np.array_equal(worn.masks["vein"], across)
    assert np.array_equal(worn.padding_mm, 2 * across)
    assert np.array_equal(worn.drains, 3 * across)
    assert np.array_equal(surface.worn(hand, across, none, None).drains, none)
    of_template = hand.v_template[:, 2]
    refined = surface.worn(hand, of_template, none, None)
    assert refined.masks["vein"] == pytest.approx(surface.subdivision @ of_template, abs=1e-12)
    assert np.array_equal(refined.masks["palm"], surface.masks["palm"])
    finer = np.concatenate([across, np.ones(7)])  # of a finer subdivision, whose first vertices are these
    assert np.array_equal(surface.at_vertices(hand, finer), across)
