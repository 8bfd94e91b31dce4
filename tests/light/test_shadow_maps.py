"""Shadows at points: spheres alone, behind one another, in contact, and behind other triangles."""

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.compute.cuda import CudaBackend
from livehand.backend.geometry.mesh import PosedMesh, posed_mesh
from livehand.backend.light.shadow_maps import FAR, MAX_DEPTH_IN_M, ShadowViews
from torch.nn.functional import normalize

pytestmark = pytest.mark.slow

NO_OCCLUDERS = torch.zeros(0, 3, 3)
MAP_PX = 128
TOWARDS = normalize(torch.tensor([[0.0, 0, 1], [1, 0, 0], [0.3, -0.5, 0.8], [-0.7, -0.6, -0.2]]), dim=-1)
FROM_AFAR = ShadowViews.along(TOWARDS, torch.full((4,), FAR))


def shadows_of(backend, mesh, topology, views=FROM_AFAR, occluders=NO_OCCLUDERS, points=None):
    points = mesh.vertices if points is None else points
    return backend.point_shadows(mesh, topology.faces, occluders, views, points, MAP_PX)


@pytest.mark.slow
def test_a_lone_sphere_is_lit_on_one_half_up_to_its_edge(spheres, backend):
    mesh, topology = spheres(((0.2, -0.1, 0.3), 0.05), subdivisions=4)
    lit = shadows_of(backend, mesh, topology).lit
    cosine = TOWARDS @ mesh.normals.T
    assert lit[cosine > 0.1].min() > 0.999
    assert lit[cosine < -0.35].max() == 0  # nearer to the edge, map pixels beside the sphere are lit
    irradiance = (lit * cosine.clamp(min=0)).mean(1)
    torch.testing.assert_close(irradiance, cosine.clamp(min=0).mean(1), atol=0, rtol=0.005)


def test_a_wall_far_behind_an_edge_is_dark_though_the_middle_of_the_mesh_is_farther(backend):
    """A rod that points at the light, with a brim that is a little wider: light runs along its side, under the brim."""
    profile = np.array([[0, 0], [0.01, 0], [0.01, 0.095], [0.0103, 0.095], [0.0103, 0.1], [0, 0.1]])
    rod = trimesh.creation.revolve(profile, sections=256)
    vertices, normals = (torch.as_tensor(np.array(v), dtype=torch.float32) for v in (rod.vertices, rod.vertex_normals))
    mesh, faces = PosedMesh(vertices, normals, torch.tensor(1.0)), torch.as_tensor(np.array(rod.faces))
    height, turn = torch.tensor([0.02, 0.05, 0.07, 0.09, 0.1]), torch.linspace(0, 6, 200)
    side = torch.stack([0.01 * turn.cos(), 0.01 * turn.sin(), torch.zeros(200)], -1)
    points = (side + height[:, None, None] * torch.tensor([0.0, 0, 1])).reshape(-1, 3)
    views = ShadowViews.along(torch.tensor([[0.0, 0, 1]]), torch.tensor([FAR]))
    lit = backend.point_shadows(mesh, faces, NO_OCCLUDERS, views, points, MAP_PX).lit.reshape(5, 200)
    assert lit[:4].max() == 0
    assert lit[4].min() > 0.999


def test_of_no_lamps_there_are_no_shadows(spheres, backend):
    mesh, topology = spheres(((0, 0, 0), 0.01), subdivisions=2)
    none = torch.zeros(0, dtype=torch.long)
    shadows = shadows_of(backend, mesh, topology, FROM_AFAR.chosen(none))
    assert shadows.lit.shape == shadows.depth_in_m.shape == (0, len(mesh.vertices))


def test_the_depth_behind_the_surface_is_the_way_of_the_light(spheres, backend):
    radius = 0.01
    mesh, topology = spheres(((0, 0, 0), radius), subdivisions=4)
    points = torch.tensor([[0.0, 0, 1], [0, 0, 0], [0, 0, -1], [0, 0.6, 0.8], [0, 0.6, -0.8]]) * radius
    found = shadows_of(backend, mesh, topology, points=points).depth_in_m[0]
    torch.testing.assert_close(found, torch.tensor([0, 1, 2, 0, 1.6]) * radius, atol=2e-4, rtol=0)


def test_just_past_the_edge_the_way_of_the_light_is_not_lost_beside_the_mesh(spheres, backend):
    """There map pixels beside the sphere are near; where light enters must not be taken from them."""
    radius = 0.02
    mesh, topology = spheres(((0, 0, 0), radius), subdivisions=5)
    past = torch.deg2rad(torch.linspace(6, 20, 29))
    points = radius * torch.stack([past.cos(), torch.zeros(29), -past.sin()], -1)
    all_of_it = torch.cat([points, mesh.vertices])  # so that the map shows all
    found = shadows_of(backend, mesh, topology, points=all_of_it).depth_in_m[0, :29]
    way = 2 * radius * past.sin()
    assert (found > 0.25 * way).all()
    assert (found < 1.05 * way).all()


@pytest.mark.parametrize("scale", [0.5, 1.0, 10.0])
def test_lengths_are_the_templates_whatever_the_scale(spheres, backend, scale):
    mesh, topology = spheres(((0, 0, 0), 0.01), subdivisions=3)
    scaled = posed_mesh(topology, mesh.vertices * scale)
    found, expected = (shadows_of(backend, one, topology) for one in (scaled, mesh))
    torch.testing.assert_close(found.depth_in_m, expected.depth_in_m, atol=2e-5, rtol=0)
    assert ((found.lit - expected.lit).abs() > 0.01).float().mean() < 0.01


@pytest.mark.slow
def test_parts_in_contact_do_not_leak(spheres, backend):
    """A small sphere rests on a large one: the place of contact is dark from above."""
    mesh, topology = spheres(((0, 0, 0), 0.05), ((0, 0, 0.062), 0.012), subdivisions=4)
    angle = torch.linspace(0, 0.1, 11)
    under = 0.05 * torch.stack([angle.sin(), torch.zeros(11), angle.cos()], -1)
    lit = shadows_of(backend, mesh, topology, points=under).lit[0]
    assert lit.max() == 0


def test_a_near_lamp_casts_a_larger_shadow(spheres, backend):
    """Of a ball of 12 mm, 50 mm before a plane's points, from 100 mm: similar triangles, 25 mm."""
    mesh, topology = spheres(((0, 0, 0), 0.012), subdivisions=4)
    radius = 0.012
    x = torch.linspace(0, 0.04, 81)
    points = torch.stack([x, torch.zeros(81), torch.full((81,), -0.05)], -1)
    views = ShadowViews.along(TOWARDS[:1], torch.tensor([0.1 / radius]))
    lit = shadows_of(backend, mesh, topology, views, points=points).lit[0]
    edge = x[lit > 0.5].min()
    grazing = np.arcsin(0.012 / 0.1)
    assert float(edge) == pytest.approx(0.15 * np.tan(grazing), abs=1.5e-3)


def test_other_triangles_block_light_but_not_from_behind(spheres, backend):
    mesh, topology = spheres(((0, 0, 0), 0.05), subdivisions=3)
    wall = torch.tensor([[[-1.0, -1, 0], [1, -1, 0], [0, 1, 0]]])
    cosine = TOWARDS[:1] @ mesh.normals.T
    before, behind = (
        shadows_of(backend, mesh, topology, occluders=wall + torch.tensor([0, 0, z])) for z in (0.2, -0.2)
    )
    assert before.lit[0].max() == 0
    assert before.depth_in_m[0].min() == pytest.approx(MAX_DEPTH_IN_M)
    assert behind.lit[:1][cosine > 0.1].min() > 0.999


def test_half_a_wall_casts_a_straight_edge(spheres, backend):
    mesh, topology = spheres(((0, 0, 0), 0.05), subdivisions=4)
    wall = torch.tensor([[[0.0, -9, 0.2], [9, -9, 0.2], [9, 9, 0.2]], [[0.0, -9, 0.2], [9, 9, 0.2], [0, 9, 0.2]]])
    lit = shadows_of(backend, mesh, topology, occluders=wall).lit[0]
    x, faces_light = mesh.vertices[:, 0], mesh.normals[:, 2] > 0.1
    assert lit[faces_light & (x > 0.002)].max() == 0
    assert lit[faces_light & (x < -0.002)].min() > 0.999


def test_a_map_is_as_fine_as_its_points_are_near(spheres, backend):
    """Over 2 mm of a sphere of 50 mm the wall's edge lies within 0.1 mm; a pixel of the whole sphere is 0.8 mm."""
    mesh, topology = spheres(((0, 0, 0), 0.05), subdivisions=4)
    wall = torch.tensor([[[0.0, -9, 0.2], [9, -9, 0.2], [9, 9, 0.2]], [[0.0, -9, 0.2], [9, 9, 0.2], [0, 9, 0.2]]])
    x = torch.linspace(-0.001, 0.001, 201)
    points = torch.stack([x, torch.zeros(201), torch.full((201,), 0.05)], -1)
    lit = shadows_of(backend, mesh, topology, occluders=wall, points=points).lit[0]
    assert lit[x > 1e-4].max() == 0
    assert lit[x < -1e-4].min() > 0.999
    assert shadows_of(backend, mesh, topology, points=points[:0]).lit.shape == (4, 0)


def test_a_lamp_within_the_mesh_or_beside_it_gives_finite_shadows(spheres, backend):
    mesh, topology = spheres(((0, 0, 0), 0.05), subdivisions=3)
    for distance in (1e-3, 0.5, 1.0, 1.01, 2.0):
        views = ShadowViews.along(TOWARDS, torch.full((4,), distance))
        shadows = shadows_of(backend, mesh, topology, views)
        assert all(values.isfinite().all() and values.min() >= 0 for values in shadows)


def test_all_backends_agree_on_a_hand(backend_pair, posed):
    hand = posed("fist")
    views = ShadowViews.along(TOWARDS, torch.tensor([FAR, 1.5, 3.0, 8.0]))
    generator = torch.Generator().manual_seed(1)
    occluders = hand.mesh.vertices.mean(0) + torch.randn(4, 3, 3, generator=generator) * 0.06
    results = [
        shadows_of(backend, hand.mesh, hand.topology, views, occluders)
        for backend in (*backend_pair, CudaBackend(backend_pair[0]))
    ]
    for fast, slow, beside_gpu in zip(*results, strict=True):
        assert torch.equal(fast, beside_gpu)
        assert ((fast - slow).abs() > 1e-3).float().mean() < 1e-3
    assert 0.1 < results[0].lit.mean() < 0.9
