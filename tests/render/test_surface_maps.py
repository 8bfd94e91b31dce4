"""Normal, atlas and position of what each pixel sees, by ray casting and by the frame of the camera."""

import numpy as np
import pytest
import trimesh
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.frame import DEPTH_BACKGROUND
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.surface_maps import nearest_maps, surface_maps

pytestmark = pytest.mark.slow

SIZE = (60, 70)


def shot_of(hand, shift=(0.0, 0.0, 0.0)):
    centre = hand.v_template.mean(0)
    cam2world = look_at(centre + np.array([0.05, 0.45, 0.1]), centre, np.array([0.0, 0, 1]))
    K = np.array([[150.0, 0, 30], [0, 150, 35], [0, 0, 1]])
    return Shot(HandPose.rest(hand.side), hand.v_template + shift, Camera(K, cam2world, SIZE))


@pytest.fixture(scope="module", params=["right", "left"])
def hand(request):
    return load_default_hand().for_side(request.param)


def first_hits(origin, directions, triangles):
    """(points, rays, faces) by every ray against every triangle (Moeller and Trumbore 1997)."""
    a, ab, ac = triangles[:, 0], triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(origin - a, ab)
    found = []
    for ray, direction in enumerate(directions):
        p = np.cross(direction, ac)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1 / (ab * p).sum(1)
            u, v, t = ((origin - a) * p).sum(1) * scale, across @ direction * scale, (ac * across).sum(1) * scale
        t[~((u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0))] = np.inf
        if np.isfinite(t.min()):
            found.append((origin + t.min() * direction, ray, t.argmin()))
    return tuple(np.array(values) for values in zip(*found, strict=True))


def test_against_ray_casting(hand):
    shot = shot_of(hand)
    maps = surface_maps(shot, load_default_hand())
    columns, rows = np.meshgrid(np.arange(SIZE[0]) + 0.5, np.arange(SIZE[1]) + 0.5)
    directions = shot.camera.ray_directions(np.stack([columns, rows], -1)).reshape(-1, 3)
    mesh = trimesh.Trimesh(shot.vertices, hand.f, process=False)
    points, ray, face = first_hits(shot.camera.origin, directions, mesh.triangles)
    is_hit = (maps.depth < DEPTH_BACKGROUND).ravel()
    assert is_hit.sum() > 400
    assert np.setxor1d(ray, np.flatnonzero(is_hit)).size <= 2
    both = is_hit[ray]
    points, ray, face = points[both], ray[both], face[both]
    np.testing.assert_allclose(maps.position.reshape(-1, 3)[ray], points, atol=1e-5)
    np.testing.assert_allclose(maps.depth.ravel()[ray], shot.camera.project(points)[1], atol=1e-5)
    weights = trimesh.triangles.points_to_barycentric(mesh.triangles[face], points)
    uv = (weights[..., None] * hand.vt[hand.ft[face]]).sum(1)
    np.testing.assert_allclose(maps.uv.reshape(-1, 3)[ray, :2], uv, atol=2e-4)
    assert (maps.uv.reshape(-1, 3)[ray, 2] == 1).all()
    normals = maps.normal.reshape(-1, 3)[ray]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1, atol=1e-5)
    # Smooth normals lean off the faces' own, but face the camera as they do.
    assert (normals * mesh.face_normals[face]).sum(1).mean() > 0.95
    beside = ~is_hit
    for values in (maps.normal, maps.uv, maps.position):
        assert not values.reshape(-1, 3)[beside].any()


def test_of_two_hands_the_nearer_is_seen(hand):
    one = surface_maps(shot_of(hand), load_default_hand())
    nearer = surface_maps(shot_of(hand, (0.0, 0.05, 0.0)), load_default_hand())
    for maps in (nearest_maps([one, nearer]), nearest_maps([nearer, one])):
        np.testing.assert_array_equal(maps.depth, np.minimum(one.depth, nearer.depth))
        where = nearer.depth < one.depth
        np.testing.assert_array_equal(maps.position[where], nearer.position[where])
        np.testing.assert_array_equal(maps.normal[~where], one.normal[~where])


def test_nothing_in_view(hand):
    shot = shot_of(hand, (10.0, 0.0, 0.0))
    maps = surface_maps(shot, load_default_hand())
    assert (maps.depth == np.float32(DEPTH_BACKGROUND)).all()
    assert not maps.uv.any()
