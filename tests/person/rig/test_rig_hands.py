"""Both hands at once are posed as each alone."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.mesh_tables import area_weighted_normals
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.person.rig.rig_hands import HandParameters, RigHands


def test_both_hands_are_posed_as_each_alone(made_rig):
    hands = made_rig.hands
    shown = hands.show(hands.parameters(made_rig.poses))
    assert shown.all_vertices.numpy() == pytest.approx(made_rig.vertices, abs=2e-6)
    assert shown.landmarks.numpy() == pytest.approx(made_rig.points, abs=2e-6)


def test_poses_come_back_from_parameters(made_rig):
    hands = made_rig.hands
    for side, pose in hands.poses(hands.parameters(made_rig.poses)).items():
        wanted = made_rig.poses[side]
        for name in ("theta", "beta", "transl", "forearm"):
            assert getattr(pose, name) == pytest.approx(getattr(wanted, name), abs=1e-6)
        assert pose.side == side


def test_landmarks_alone_are_those_of_the_whole_hand(made_rig):
    hands = made_rig.hands
    parameters = hands.parameters(made_rig.poses)
    alone = hands.of_landmarks_alone()
    assert alone.skin.v_template.shape == (21, 3)
    assert alone.show(parameters).landmarks.numpy() == pytest.approx(hands.show(parameters).landmarks.numpy(), abs=1e-6)


def test_faces_are_wound_outward_on_both_sides(made_rig):
    hands, vertices = made_rig.hands, made_rig.vertices
    corners = vertices[hands.faces.numpy()]
    for side in range(2):
        part = corners[side * len(corners) // 2 : (side + 1) * len(corners) // 2]
        middle = part.reshape(-1, 3).mean(0)
        volume = np.einsum("fi,fi->f", part[:, 0] - middle, np.cross(part[:, 1] - middle, part[:, 2] - middle)).sum()
        assert volume > 0


def test_normals_at_rest_are_the_templates_and_turn_with_the_hand(made_rig):
    hands = RigHands.of(made_rig.model, ("right", "left"))
    flat = HandParameters(torch.zeros(2, 16, 3), torch.zeros(10), torch.zeros(2, 3), torch.zeros(2, 3))
    normals = hands.posed_normals(flat)
    wanted = area_weighted_normals(made_rig.model.v_template, made_rig.model.f)
    wanted /= np.linalg.norm(wanted, axis=1, keepdims=True)
    assert normals[0].numpy() == pytest.approx(wanted, abs=1e-5)
    assert normals[1].numpy() == pytest.approx(wanted * (-1, 1, 1), abs=1e-5)
    posed = hands.posed_normals(hands.parameters(made_rig.poses))
    for row, (side, pose) in enumerate(made_rig.poses.items()):
        own = area_weighted_normals(posed_arrays(made_rig.model, pose)[0], made_rig.model.for_side(side).f)
        own /= np.linalg.norm(own, axis=1, keepdims=True)
        assert np.median((posed[row].numpy() * own).sum(1)) > 0.99
