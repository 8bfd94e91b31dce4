"""Places on a mesh by the kernel against `light.bounce.SkinPlaces.of`."""

import torch
from livehand.backend.compute.cpu.places import skin_places
from livehand.backend.light.bounce import SkinPlaces


def test_places_are_those_of_torch(posed):
    mesh, faces = posed("fist").mesh, posed("fist").topology.faces
    random = torch.Generator().manual_seed(2)
    face = torch.randint(-1, len(faces), (3000,), generator=random, dtype=torch.int32)
    face[::50] = -1
    inside = torch.rand(3000, 3, generator=random)
    corners = mesh.vertices[faces[face.clamp(min=0).long()]]
    position = (corners * (inside / inside.sum(1, keepdim=True))[..., None]).sum(1)
    position += 0.001 * torch.randn(3000, 3, generator=random)  # some lie beside their face
    ours, theirs = skin_places(mesh, faces, face, position), SkinPlaces.of(mesh, faces, face, position)
    assert torch.equal(ours.vertex, theirs.vertex)
    torch.testing.assert_close(ours.weight, theirs.weight, atol=1e-4, rtol=0)
    assert torch.equal(ours.is_beside, theirs.is_beside)
    assert ours.is_beside.sum() == 60
    assert (theirs.weight == 0).any(1).sum() > 300


def test_a_face_without_area_is_none(posed):
    mesh = posed("open").mesh
    face, position = torch.zeros(1, dtype=torch.int32), mesh.vertices[:1]
    places = skin_places(mesh, torch.tensor([[5, 5, 9]]), face, position)
    assert places.weight.tolist() == [[0, 0, 0]]


def test_no_points_have_no_places(posed):
    hand = posed("open")
    nothing = torch.zeros(0, dtype=torch.int32), torch.zeros(0, 3)
    assert skin_places(hand.mesh, hand.topology.faces, *nothing).vertex.shape == (0, 3)
