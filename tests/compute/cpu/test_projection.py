"""Projection by the kernel against double precision."""

import torch
from livehand.backend.compute.cpu.projection import projected_mesh
from livehand.backend.field.rays import project


def test_projection_is_that_of_torch_in_double_precision(posed, seen_from):
    hand = posed("fist")
    view = seen_from(hand.mesh, (0.3, -1, 0.2), size_px=(500, 480))
    skewed = view._replace(K=view.K + torch.tensor([[0.0, 0.7, 0], [0, 0, 0], [0.01, 0, 0]]))
    for camera in (view, skewed):
        mesh = projected_mesh(camera, hand.mesh.vertices, hand.topology.faces)
        finely = camera._replace(K=camera.K.double(), world2cam=camera.world2cam.double())
        expected_px, expected_m = project(finely, hand.mesh.vertices.double())
        torch.testing.assert_close(torch.tensor(mesh.positions_px).double(), expected_px, atol=0, rtol=1e-7)
        torch.testing.assert_close(torch.tensor(mesh.depth).double(), expected_m, atol=0, rtol=1e-7)
    assert torch.equal(torch.tensor(mesh.faces), hand.topology.faces)
