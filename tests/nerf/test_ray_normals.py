"""Normals of a known surface at rays: against a sphere's and a plane's, and both backends against each other."""

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.fast.backend import NumbaBackend
from livehand.backend.nerf.fine_mesh import FineMesh
from livehand.backend.nerf.part_edges import SurfaceBones
from livehand.backend.nerf.rays import camera_tensors, ray_directions, ray_origin
from livehand.backend.nerf.reference import ReferenceBackend
from livehand.backend.nerf.relighting import doubled
from livehand.backend.records.camera import Camera
from torch.nn.functional import normalize

SIZE = (120, 100)  # of the rays' image
EDGE_M = torch.tensor(0.003)
PIXEL = torch.arange(SIZE[0] * SIZE[1])


@pytest.fixture(params=[ReferenceBackend, NumbaBackend])
def backend(request):
    return request.param()


def camera():
    """Looks along -Z from Z = 1 m, with a focal length of 250 px."""
    cam2world = np.diag([1.0, -1, -1, 1])
    cam2world[2, 3] = 1
    K = np.array([[250.0, 0, SIZE[0] / 2], [0, 250, SIZE[1] / 2], [0, 0, 1]])
    return camera_tensors(Camera(K, cam2world, SIZE), "cpu")


def mesh_of(vertices, normals, faces):
    bones = SurfaceBones(torch.zeros(len(faces), dtype=torch.int8), torch.tensor([[False]]))
    corner_uv, flex = torch.zeros(len(faces), 3, 2), torch.zeros(len(vertices))
    return FineMesh(vertices, normals, faces, corner_uv, flex, torch.tensor(1.0), bones)


def ball(radius_m):
    mesh = trimesh.creation.icosphere(5, radius_m)
    vertices = torch.as_tensor(mesh.vertices, dtype=torch.float32)
    return mesh_of(vertices, vertices / radius_m, torch.as_tensor(np.array(mesh.faces)))


def found(backend, mesh, position, view=None):
    full = doubled(view or camera())
    return backend.ray_normals(mesh, backend.seen_surface(mesh, full), full, PIXEL, position, EDGE_M)


def on_ball(radius_m):
    """Where rays meet a ball about the origin, and whether they do."""
    origin, towards = ray_origin(camera()), normalize(ray_directions(camera(), PIXEL), dim=-1)
    along = -(towards @ origin)
    inside = radius_m**2 - (origin @ origin - along**2)
    return origin + (along - inside.clamp(min=0).sqrt())[:, None] * towards, inside > 0


def test_rays_have_the_normals_of_a_ball_where_they_meet_it(backend):
    position, meets = on_ball(0.15)
    normals = found(backend, ball(0.15), position)
    assert meets.sum() > 4000
    inner = meets & (position[:, 2] > 0.09)
    assert (normals[inner] * position[inner] / 0.15).sum(1).min() > np.cos(np.deg2rad(1.5))
    outside = (ray_directions(camera(), PIXEL)[:, :2].norm(dim=1) > 0.19) & ~meets
    assert outside.sum() > 4000
    assert normals[outside].eq(0).all()


def test_rays_that_meet_another_surface_have_none(backend):
    position, _ = on_ball(0.15)
    towards, near = ray_directions(camera(), PIXEL), position[:, 2] > 0.149
    assert near.sum() > 50
    assert found(backend, ball(0.15), position + 0.0034 * towards)[near].eq(0).all()
    assert found(backend, ball(0.15), position + 0.0026 * towards)[near].any(1).all()


def test_normals_are_those_of_the_rays_not_of_pixels_beside_them(backend):
    """On a plane whose normals turn from left to right, as perspective interpolates them between corners."""
    x = torch.tensor([-0.3, 0.3])
    vertices = torch.tensor([[x[i], y, 0.0] for y in (-0.3, 0.3) for i in (0, 1)])
    normals = normalize(torch.tensor([[s, 0, 1.0] for _ in (0, 1) for s in (-0.5, 0.5)]), dim=-1)
    plane = mesh_of(vertices, normals, torch.tensor([[0, 1, 3], [0, 3, 2]]))
    position = ray_origin(camera()) + ray_directions(camera(), PIXEL)
    expected = normalize(torch.stack([position[:, 0] / 0.6, 0 * position[:, 0], torch.ones(len(PIXEL))], 1), dim=-1)
    torch.testing.assert_close(found(backend, plane, position), expected, atol=1e-5, rtol=0)


def test_both_backends_find_the_same_normals_on_a_hand(fine_hand, seen_from):
    mesh = fine_hand("fist", "right")
    view = seen_from(mesh, (0.2, -1, 0.4), size_px=(60, 55))
    pixel, full = torch.arange(60 * 55), doubled(view)
    seen = NumbaBackend().seen_surface(mesh, full)
    depth = seen.depth.reshape(110, 120)[1::2, 1::2].flatten()
    position = ray_origin(view) + torch.where(depth.isfinite(), depth, 9.0)[:, None] * ray_directions(view, pixel)
    ours, theirs = (
        each().ray_normals(mesh, seen, full, pixel, position, EDGE_M) for each in (NumbaBackend, ReferenceBackend)
    )
    assert ours.any(1).sum() > 500
    torch.testing.assert_close(ours, theirs, atol=2e-4, rtol=0)
