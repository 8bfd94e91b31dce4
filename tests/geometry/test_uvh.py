"""Canonical coordinates: heights by construction, signs, scale, and atlas seams."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.closest_point import closest_on_triangles
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.geometry.uvh import SurfaceSamples, atlas_uv, interpolate, signed_height
from livehand.backend.hand.topology import topology_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def topology(hand):
    return topology_of(hand)


@pytest.fixture(scope="module")
def mesh(hand, topology):
    return posed_mesh(topology, torch.as_tensor(hand.v_template, dtype=torch.float32))


@pytest.fixture(scope="module")
def lay(topology, nearest_face):
    """A function (points, mesh) -> samples on the nearest of all faces, height in the template's metres."""

    def on_surface(points, mesh):
        triangles = mesh.vertices[topology.faces]
        face, _ = nearest_face(points, triangles)
        barycentric, squared = closest_on_triangles(points, triangles[face])
        height = signed_height(points, SurfaceSamples(face, barycentric, squared.sqrt()), topology, mesh)
        return SurfaceSamples(face, barycentric, height / mesh.scale)

    return on_surface


def face_points(mesh, topology, share=(0.5, 0.3, 0.2)):
    """A point inside every face, and the face's unit normal."""
    corners = mesh.vertices[topology.faces]
    normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return (corners * torch.tensor(share)[:, None]).sum(1), torch.nn.functional.normalize(normals, dim=-1)


@pytest.mark.parametrize("height", [1e-3, 2e-4, 0.0, -2e-4, -1e-3])
def test_a_point_pushed_along_the_normal_has_that_height(mesh, topology, lay, height):
    points, normals = face_points(mesh, topology)
    samples = lay(points + height * normals, mesh)
    is_own = samples.face == torch.arange(len(topology.faces))
    assert is_own.double().mean() > 0.99  # in a narrow fold another face is closer
    error = (samples.height_m - height).abs()[is_own]
    # One face lies in a fold so sharp that its corners' normals point away from its own.
    assert int((error > 2e-7).sum()) <= 1
    inside = samples.barycentric[is_own]
    torch.testing.assert_close(inside, torch.tensor([0.5, 0.3, 0.2]).expand_as(inside), atol=2e-3, rtol=0)


def test_vertices_are_outside_when_pushed_out_and_inside_when_pushed_in(mesh, lay):
    out = lay(mesh.vertices + 0.0005 * mesh.normals, mesh)
    within = lay(mesh.vertices - 0.0005 * mesh.normals, mesh)
    # Here is the bottom of a sharp fold: half a millimetre outwards is already under the fold's other side.
    fold = int((mesh.vertices - torch.tensor([-0.0169, -0.0015, 0.0170])).norm(dim=1).argmin())
    assert set((out.height_m <= 0).nonzero()[:, 0].tolist()) <= {fold}
    assert (within.height_m < 0).all()


def test_the_sign_is_that_of_a_point_in_polyhedron_test(mesh, topology, lay):
    generator = torch.Generator().manual_seed(0)
    vertex = torch.randint(len(mesh.vertices), (1500,), generator=generator)
    points = mesh.vertices[vertex] + 0.0025 * torch.randn(1500, 3, generator=generator)
    samples = lay(points, mesh)
    clear = samples.height_m.abs() > 2e-4
    # winding number of the closed surface, by the solid angles of its faces (van Oosterom and Strackee 1983)
    corners = mesh.vertices.double()[topology.faces][None] - points.double()[:, None, None]
    length = corners.norm(dim=-1)
    a, b, c = corners.unbind(2)
    dots = [(x * y).sum(-1) for x, y in ((a, b), (b, c), (c, a))]
    below = length.prod(-1) + dots[0] * length[..., 2] + dots[1] * length[..., 0] + dots[2] * length[..., 1]
    winding = torch.atan2((a * torch.linalg.cross(b, c)).sum(-1), below).sum(1) / (2 * torch.pi)
    is_inside = winding.round() == 1
    assert 200 < int((is_inside & clear).sum()) < 1300
    disagree = ((samples.height_m < 0) != is_inside) & clear
    assert disagree.double().mean() < 0.002


def test_a_larger_world_has_the_same_coordinates(mesh, topology, lay):
    points = mesh.vertices[::5] + torch.tensor([0.001, -0.0007, 0.0004])
    large = posed_mesh(topology, mesh.vertices * 10)
    assert float(large.scale) == pytest.approx(10, rel=1e-5)
    assert float(mesh.scale) == pytest.approx(1, rel=1e-6)
    one, other = lay(points, mesh), lay(points * 10, large)
    torch.testing.assert_close(other.height_m, one.height_m, atol=1e-7, rtol=1e-4)
    same = one.face == other.face  # on a shared edge either face will do
    assert same.double().mean() > 0.95
    torch.testing.assert_close(atlas_uv(topology, other)[same], atlas_uv(topology, one)[same], atol=2e-5, rtol=0)


def test_atlas_coordinates_come_from_the_faces_own_chart(hand, mesh, topology, lay):
    """On both sides of a seam: the interpolation never runs through the other chart."""
    points, normals = face_points(mesh, topology, (0.98, 0.01, 0.01))
    samples = lay(points + 1e-5 * normals, mesh)
    own = samples.face == torch.arange(len(topology.faces))
    expected = np.einsum("c,fcx->fx", [0.98, 0.01, 0.01], hand.vt[hand.ft])
    np.testing.assert_allclose(atlas_uv(topology, samples)[own], expected[own.numpy()], atol=2e-4)
    corner_count = {}
    for vertex, corner in zip(hand.f.ravel(), hand.ft.ravel(), strict=True):
        corner_count.setdefault(int(vertex), set()).add(int(corner))
    on_seam = torch.tensor([len(corner_count[int(vertex)]) > 1 for vertex in hand.f[:, 0]])
    assert int((on_seam & own).sum()) > 20


def test_interpolation_is_linear(mesh, topology, lay):
    points = mesh.vertices[::9] + 0.001
    samples = lay(points, mesh)
    at = interpolate(mesh.vertices, topology, samples)
    slope = torch.tensor([[1.0, 2], [0, -3], [4, 1]])
    torch.testing.assert_close(interpolate(mesh.vertices @ slope, topology, samples), at @ slope, atol=1e-6, rtol=0)


def test_heights_of_points_against_one_corner_by_hand(topology, mesh):
    """The sign is that of the offset along the interpolated normal; the length is taken as it is given."""
    nearest = SurfaceSamples(torch.tensor([5, 5]), torch.tensor([[1.0, 0, 0]]).expand(2, 3), torch.tensor([0.25, 4.0]))
    corner = topology.faces[5, 0]
    points = mesh.vertices[corner] + torch.tensor([[1.0], [-1.0]]) * mesh.normals[corner]
    assert signed_height(points, nearest, topology, mesh).tolist() == [0.25, -4.0]
