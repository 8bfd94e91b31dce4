"""Light from skin to skin: form factors in closed form, and on a hand."""

from math import pi

import pytest
import torch
from livehand.backend.light.indirect_diffuse import (
    MOST_SURFELS,
    MeshPoints,
    Surfels,
    indirect_diffuse_on_mesh,
    surfel_vertices,
)
from torch.nn.functional import normalize

UP, DOWN = torch.tensor([0.0, 0, 1]), torch.tensor([0.0, 0, -1])


@pytest.fixture
def indirect_diffuse(backend):
    """A backend's implementation."""
    return backend.indirect_diffuse


def plane(height_m, side_m, normal, cells=200):
    """A square at a height, in equal discs."""
    at = (torch.arange(cells) + 0.5) / cells - 0.5
    x, y = (value.flatten() * side_m for value in torch.meshgrid(at, at, indexing="ij"))
    position = torch.stack([x, y, torch.full_like(x, height_m)], 1)
    return discs(position, normal.expand(len(x), 3), (side_m / cells) ** 2)


def discs(position, normal, area_m2):
    return Surfels(position, normal, torch.arange(len(position)), torch.full((len(position),), area_m2))


def at(*hit_points):
    return torch.tensor(hit_points)


def test_a_disc_overhead_is_seen_by_its_form_factor(indirect_diffuse):
    """On the axis of a disc of radius r at height h: r^2 / (r^2 + h^2)."""
    radius, height = 0.02, 0.03
    disc = discs(at([0.0, 0, height]), DOWN[None], pi * radius**2)
    found = indirect_diffuse(torch.zeros(1, 3), UP[None], disc, at([1.0, 2.0, 0.5]))
    expected = radius**2 / (radius**2 + height**2)
    torch.testing.assert_close(found, expected * at([1.0, 2.0, 0.5]))


def test_a_wide_plane_covers_the_sky_and_what_lies_behind_counts_nothing(indirect_diffuse):
    wide = plane(0.01, 0.4, DOWN)
    emitted = torch.ones(len(wide.position), 3)
    normals = torch.stack([UP, DOWN, torch.tensor([1.0, 0, 0])])
    found = indirect_diffuse(torch.zeros(3, 3), normals, wide, emitted)[:, 0]
    assert found[0] == pytest.approx(1, abs=0.03)
    assert found[1] == 0
    assert found[2] == pytest.approx(0.5, abs=0.03)
    turned = wide._replace(normals=-wide.normals)
    assert indirect_diffuse(torch.zeros(1, 3), UP[None], turned, emitted).abs().max() == 0


def test_no_more_arrives_than_is_shed_however_near(indirect_diffuse):
    near = plane(1e-5, 0.05, DOWN)
    emitted = torch.rand(len(near.position), 3, generator=torch.Generator().manual_seed(0))
    found = indirect_diffuse(torch.zeros(1, 3), UP[None], near, emitted)
    assert (found <= emitted.amax(0)).all()
    assert found.isfinite().all()
    same = indirect_diffuse(near.position[:1], UP[None], near, emitted)  # a point on the disc itself
    assert same.isfinite().all()


def test_probes_have_the_hands_area(posed):
    hand = posed("open")
    surfels = Surfels.of(hand.mesh, hand.topology)
    a, b, c = hand.mesh.vertices[hand.topology.faces].unbind(1)
    area_m2 = float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum() / 2)
    assert float(surfels.area_m2.sum()) == pytest.approx(area_m2, rel=1e-4)
    assert torch.equal(surfel_vertices(len(hand.mesh.vertices)), torch.arange(len(hand.mesh.vertices)))
    assert len(surfel_vertices(5000).unique()) == MOST_SURFELS


@pytest.mark.parametrize("most", [100, 5000])
def test_a_part_of_the_vertices_may_stand_for_all(posed, most):
    """A fist sheds as much light on itself by a third of its discs, but for their size."""
    hand = posed("fist")
    surfels = Surfels.of(hand.mesh, hand.topology, most)
    assert len(surfels.chosen) == min(most, len(hand.mesh.vertices))
    a, b, c = hand.mesh.vertices[hand.topology.faces].unbind(1)
    area_m2 = float(torch.linalg.cross(b - a, c - a).norm(dim=1).sum() / 2)
    assert float(surfels.area_m2.sum()) == pytest.approx(area_m2, rel=1e-4)


def test_points_on_faces_receive_the_mean_of_their_corners_and_those_beside_their_own(posed, indirect_diffuse):
    hand = posed("fist")
    faces, vertices = hand.topology.faces, hand.mesh.vertices
    surfels = Surfels.of(hand.mesh, hand.topology)
    weight = torch.tensor([0.5, 0.3, 0.2])
    on_faces = (vertices[faces[:40]] * weight[:, None]).sum(1) + 0.0003 * hand.mesh.normals[faces[:40, 0]]
    beside = torch.tensor([[0.3, 0.0, 0.0]])
    position = torch.cat([on_faces, beside])
    normal = torch.cat([hand.mesh.normals[faces[:40, 0]], -normalize(beside, dim=-1)])
    hit_points = MeshPoints.of(hand.mesh, faces, torch.cat([torch.arange(40), torch.tensor([-1])]), position)
    torch.testing.assert_close(hit_points.weight[:40], weight.expand(40, 3), atol=0.15, rtol=0)
    torch.testing.assert_close(hit_points.weight[:40].sum(1), torch.ones(40))
    assert hit_points.is_beside.tolist() == [False] * 40 + [True]
    emitted = torch.rand(len(surfels.chosen), 3, generator=torch.Generator().manual_seed(0))
    found = indirect_diffuse_on_mesh(hit_points, position, normal, surfels, emitted, indirect_diffuse)
    at_vertices = indirect_diffuse(vertices, hand.mesh.normals, surfels, emitted)
    expected = (at_vertices[faces[:40]] * hit_points.weight[:40, :, None]).sum(1)
    torch.testing.assert_close(found[:40], expected)
    torch.testing.assert_close(found[40:], indirect_diffuse(beside, normal[40:], surfels, emitted))
    assert found[40:].min() > 0


@pytest.mark.parametrize(("gesture", "share", "least", "most"), [("fist", 0.95, 0.6, 1.0), ("open", 0.1, 0.0, 0.05)])
def test_a_fist_lights_its_inside_and_an_open_hand_not_its_back(posed, indirect_diffuse, gesture, share, least, most):
    hand = posed(gesture)
    surfels = Surfels.of(hand.mesh, hand.topology)
    found = indirect_diffuse(hand.mesh.vertices, hand.mesh.normals, surfels, torch.ones(len(surfels.chosen), 3))[:, 0]
    assert least <= float(found.quantile(share)) <= most


def test_vertices_are_asked_for_light_only_where_points_are():
    """Of four vertices the third is no corner; points have the light of theirs."""
    surfels = discs(torch.eye(4, 3), UP.expand(4, 3), 1e-4)
    asked = []

    def heights(position, normal, surfels, emitted):
        asked.append(position)
        return position + 2

    points = MeshPoints(torch.tensor([[0, 1, 3], [1, 3, 0]]), at([1.0, 0, 0], [0, 0.25, 0.75]))
    found = indirect_diffuse_on_mesh(points, torch.zeros(2, 3), UP.expand(2, 3), surfels, torch.ones(4, 3), heights)
    assert points.corners(4).tolist() == [0, 1, 3]
    torch.testing.assert_close(asked[0], surfels.position[[0, 1, 3]])
    torch.testing.assert_close(found, at([3.0, 2, 2], [2.75, 2, 2]))


def test_places_are_the_references(posed, backend_pair):
    mesh, faces = posed("fist").mesh, posed("fist").topology.faces
    random = torch.Generator().manual_seed(2)
    face = torch.randint(-1, len(faces), (3000,), generator=random, dtype=torch.int32)
    face[::50] = -1
    inside = torch.rand(3000, 3, generator=random)
    corners = mesh.vertices[faces[face.clamp(min=0).long()]]
    position = (corners * (inside / inside.sum(1, keepdim=True))[..., None]).sum(1)
    position += 0.001 * torch.randn(3000, 3, generator=random)  # some lie beside their face
    ours, theirs = (each.mesh_points(mesh, faces, face, position) for each in backend_pair)
    assert torch.equal(ours.vertex, theirs.vertex)
    torch.testing.assert_close(ours.weight, theirs.weight, atol=1e-4, rtol=0)
    assert torch.equal(ours.is_beside, theirs.is_beside)
    assert ours.is_beside.sum() == 60
    assert (theirs.weight == 0).any(1).sum() > 300


def test_a_face_without_area_is_none(posed, backend):
    mesh = posed("open").mesh
    face, position = torch.zeros(1, dtype=torch.int32), mesh.vertices[:1]
    hit_points = backend.mesh_points(mesh, torch.tensor([[5, 5, 9]]), face, position)
    assert hit_points.weight.tolist() == [[0, 0, 0]]


def test_no_points_have_no_places(posed, backend):
    hand = posed("open")
    nothing = torch.zeros(0, dtype=torch.int32), torch.zeros(0, 3)
    assert backend.mesh_points(hand.mesh, hand.topology.faces, *nothing).vertex.shape == (0, 3)
