"""Slopes in closed form are those of automatic differentiation, at rest, at small turns and at large ones."""

import numpy as np
import pytest
import torch
from livehand.backend.geometry.torch_rotation import axis_angle_to_matrix
from livehand.backend.hand.lbs import SkinTensors, pose_hand
from livehand.backend.hand.lbs_slopes import (
    BETA,
    FOREARM,
    THETA,
    TRANSL,
    UNKNOWNS,
    VertexSubset,
    posed_part,
    turn_slopes,
    vertex_slopes,
)
from livehand.backend.hand.model_file import load_default_hand

ROUNDING = 1e-13  # m per rad; sums of some hundred float64 products of metres


def _split(unknowns):
    return unknowns[THETA].reshape(16, 3), unknowns[BETA], unknowns[TRANSL], unknowns[FOREARM]


@pytest.mark.parametrize("largest", [0.0, 1e-4, 0.6, 2.0])
def test_slopes_are_those_of_automatic_differentiation(largest):
    skin = SkinTensors.of(load_default_hand(), dtype=torch.float64)
    unknowns = torch.as_tensor(np.random.default_rng(3).uniform(-largest, largest, UNKNOWNS))
    vertices = torch.arange(0, len(skin.v_template), 61)
    part = VertexSubset.of(skin, vertices)
    found = vertex_slopes(part, *_split(unknowns))

    def posed(values):
        return pose_hand(skin, *_split(values)).vertices[vertices]

    wanted = torch.autograd.functional.jacobian(posed, unknowns)
    torch.testing.assert_close(found.vertices, posed(unknowns), atol=ROUNDING, rtol=0)
    torch.testing.assert_close(found.slopes, wanted, atol=ROUNDING, rtol=0)
    torch.testing.assert_close(posed_part(part, *_split(unknowns)), found.vertices, atol=0, rtol=0)


@pytest.mark.parametrize("angle", [0.0, 9.9e-4, 1.01e-3, 0.5, 3.0])
def test_a_change_of_axis_angle_turns_as_said(angle):
    axis_angle = angle * torch.tensor([0.48, -0.6, 0.64], dtype=torch.float64)
    change = 1e-6 * torch.tensor([0.3, 0.8, -0.5], dtype=torch.float64)
    turned = axis_angle_to_matrix(axis_angle + change) @ axis_angle_to_matrix(axis_angle).T
    wanted = axis_angle_to_matrix(turn_slopes(axis_angle) @ change)
    torch.testing.assert_close(turned, wanted, atol=4e-12, rtol=0)  # the square of the change, and rounding
