"""How the surface has turned: rigid turns, joints, scale, and the mirrored hand."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.local_rotation import local_rotations
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.geometry.torch_rotation import axis_angle_to_matrix
from livehand.backend.hand.lbs import SkinTensors, pose_hand
from livehand.backend.hand.model import MIRROR_POINT
from livehand.backend.hand.topology import topology_of


def rotations_of(topology, vertices):
    mesh = posed_mesh(topology, vertices)
    return local_rotations(mesh.vertices, mesh.normals, topology.frames)


def template_of(model):
    return torch.as_tensor(model.v_template, dtype=torch.float32)


@pytest.mark.parametrize("vector", [[0.0, 0, 0], [0.3, -1.2, 2.0], [0, 0, 3.1]])
@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0])
def test_a_hand_turned_as_a_whole_has_turned_so_everywhere(hand, vector, scale):
    topology = topology_of(hand)
    turn = axis_angle_to_matrix(torch.tensor(vector))
    found = rotations_of(topology, scale * template_of(hand) @ turn.T + torch.tensor([0.1, 0.2, -0.3]))
    torch.testing.assert_close(found, turn.expand_as(found), atol=2e-3, rtol=0)


def test_they_are_rotations_in_any_pose(hand):
    theta = 0.5 * torch.randn(16, 3, generator=torch.Generator().manual_seed(0))
    posed = pose_hand(SkinTensors.of(hand), theta, torch.zeros(10), torch.zeros(3)).vertices
    found = rotations_of(topology_of(hand), posed)
    torch.testing.assert_close(found @ found.mT, torch.eye(3).expand_as(found), atol=1e-4, rtol=0)
    assert (torch.linalg.det(found) > 0.99).all()


def test_skin_that_hangs_on_one_joint_turns_with_it(hand):
    theta = torch.zeros(16, 3)
    theta[5] = torch.tensor([0.2, -0.4, 0.9])
    posed = pose_hand(SkinTensors.of(hand), theta, torch.zeros(10), torch.zeros(3))
    found = rotations_of(topology_of(hand), posed.vertices)
    hangs = hand.lbs_weights[:, 6] > 0.999
    alone = hangs & ~np.isin(np.arange(len(hangs)), hand.f[(~hangs[hand.f]).any(1)])
    assert alone.sum() > 5
    error = found[torch.as_tensor(alone)] - posed.transforms[6, :3, :3]
    assert error.abs().max() < 0.15  # pose correctives bend the skin a little
    assert error.abs().median() < 0.02
    far = hand.lbs_weights[:, 13:].sum(1) > 0.999
    assert (found[torch.as_tensor(far)] - torch.eye(3)).abs().median() < 1e-3


def test_the_other_hand_is_the_canonical_ones_mirror(hand):
    """Canonical directions reach the left hand mirrored, and then turned with it."""
    left = hand.for_side("left")
    mirror = torch.diag(torch.as_tensor(MIRROR_POINT, dtype=torch.float32))
    turn = axis_angle_to_matrix(torch.tensor([0.5, 0.3, -0.8]))
    found = rotations_of(topology_of(left, canonical_side="right"), template_of(left) @ turn.T)
    torch.testing.assert_close(found, (turn @ mirror).expand_as(found), atol=2e-3, rtol=0)
    own = rotations_of(topology_of(left), template_of(left) @ turn.T)
    torch.testing.assert_close(own, turn.expand_as(own), atol=2e-3, rtol=0)


def test_a_mirrored_pose_is_turned_in_mirror_image(hand):
    theta = 0.4 * torch.randn(16, 3, generator=torch.Generator().manual_seed(1))
    right = pose_hand(SkinTensors.of(hand), theta, torch.zeros(10), torch.zeros(3)).vertices
    mirror = torch.diag(torch.as_tensor(MIRROR_POINT, dtype=torch.float32))
    left = topology_of(hand.for_side("left"), canonical_side="right")
    torch.testing.assert_close(
        rotations_of(left, right @ mirror), mirror @ rotations_of(topology_of(hand), right), atol=2e-3, rtol=0
    )


def test_gradients_and_collapsed_hands_are_finite(hand):
    topology = topology_of(hand)
    vertices = template_of(hand).requires_grad_()
    rotations_of(topology, vertices).sum().backward()
    assert vertices.grad.isfinite().all()
    assert rotations_of(topology, torch.zeros(len(hand.v_template), 3)).isfinite().all()
