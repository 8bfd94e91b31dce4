"""Where rays meet a known surface: against a sphere and a plane, and both backends against each other."""

import numpy as np
import torch
import trimesh
from livehand.backend.field.rays import camera_tensors, ray_directions, ray_origin, ray_origins
from livehand.backend.records.camera import Camera
from livehand.backend.surface.detail_mesh import DetailMesh
from livehand.backend.surface.edge_antialiasing import SurfaceBones
from livehand.backend.surface.ray_hits import RayHits
from torch.nn.functional import normalize

SIZE = (120, 100)  # of the rays' image
PIXEL = torch.arange(SIZE[0] * SIZE[1])


def camera():
    """Looks along -Z from Z = 1 m, with a focal length of 250 px."""
    cam2world = np.diag([1.0, -1, -1, 1])
    cam2world[2, 3] = 1
    K = np.array([[250.0, 0, SIZE[0] / 2], [0, 250, SIZE[1] / 2], [0, 0, 1]])
    return camera_tensors(Camera(K, cam2world, SIZE), "cpu")


def mesh_of(vertices, normals, faces):
    bones = SurfaceBones(torch.zeros(len(faces), dtype=torch.int8), torch.tensor([[False]]))
    corner_uv, flex = torch.zeros(len(faces), 3, 2), torch.zeros(len(vertices))
    return DetailMesh(vertices, normals, faces, corner_uv, flex, torch.tensor(1.0), bones, faces)


def ball(radius_m):
    mesh = trimesh.creation.icosphere(5, radius_m)
    vertices = torch.as_tensor(mesh.vertices, dtype=torch.float32)
    return mesh_of(vertices, vertices / radius_m, torch.as_tensor(np.array(mesh.faces)))


def on_ball(radius_m):
    """How deep rays meet a ball about the origin, where, and whether they do."""
    origin, towards = ray_origin(camera()), ray_directions(camera(), PIXEL)
    squared, along = (towards * towards).sum(1), -(towards @ origin)
    inside = along**2 - squared * (origin @ origin - radius_m**2)
    depth = (along - inside.clamp(min=0).sqrt()) / squared
    return depth, origin + depth[:, None] * towards, inside > 0


def test_rays_meet_a_ball_where_it_is_and_have_its_normals(backend):
    depth, position, meets = on_ball(0.15)
    hits = backend.ray_hits(ball(0.15), camera(), PIXEL)
    assert meets.sum() > 4000
    inner = meets & (position[:, 2] > 0.05)
    torch.testing.assert_close(hits.depth[inner], depth[inner], atol=2e-4, rtol=0)
    torch.testing.assert_close(hits.normal[inner], position[inner] / 0.15, atol=2e-3, rtol=0)
    beside = torch.full((len(PIXEL), 3), 7.0)
    found = hits.positions(ray_origins(camera(), PIXEL), ray_directions(camera(), PIXEL), beside)
    torch.testing.assert_close(found[inner], position[inner], atol=2e-4, rtol=0)
    assert torch.equal(found[hits.depth == torch.inf], beside[hits.depth == torch.inf])
    assert (~meets).sum() > 4000
    assert hits.depth[~meets].isinf().all()
    assert hits.normal[~meets].eq(0).all()


def test_normals_are_those_of_pixels_centres(backend):
    """On a plane whose normals turn from left to right, as perspective interpolates them between corners."""
    x = torch.tensor([-0.3, 0.3])
    vertices = torch.tensor([[x[i], y, 0.0] for y in (-0.3, 0.3) for i in (0, 1)])
    normals = normalize(torch.tensor([[s, 0, 1.0] for _ in (0, 1) for s in (-0.5, 0.5)]), dim=-1)
    hits = backend.ray_hits(mesh_of(vertices, normals, torch.tensor([[0, 1, 3], [0, 3, 2]])), camera(), PIXEL)
    across = ray_directions(camera(), PIXEL)[:, 0]
    expected = normalize(torch.stack([across / 0.6, 0 * across, torch.ones(len(PIXEL))], 1), dim=-1)
    torch.testing.assert_close(hits.normal, expected, atol=1e-5, rtol=0)
    torch.testing.assert_close(hits.depth, torch.ones(len(PIXEL)), atol=1e-6, rtol=0)


def test_both_backends_find_the_same_on_a_hand(backend_pair, fine_hand, view_from):
    mesh = fine_hand("fist", "right")
    view, pixel = view_from(mesh, (0.2, -1, 0.4), size_px=(60, 55)), torch.arange(60 * 55)
    ours, theirs = (each.ray_hits(mesh, view, pixel) for each in backend_pair)
    assert ours.depth.isfinite().sum() > 500
    torch.testing.assert_close(ours.depth, theirs.depth, atol=1e-5, rtol=0)
    torch.testing.assert_close(ours.normal, theirs.normal, atol=2e-4, rtol=0)


def test_depths_that_differ_by_half_an_edge_are_of_another_part():
    hits = RayHits(torch.tensor([0.5, 0.5, 0.5, torch.inf, 0.5]), torch.zeros(5, 3))
    other = hits.is_of_other_part(torch.tensor([0.5014, 0.5016, 0.4984, 0.5, torch.inf]), torch.tensor(0.003))
    assert other.tolist() == [False, True, True, False, True]
