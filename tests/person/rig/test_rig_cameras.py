"""Cameras as tensors project as their records do, turned or not."""

import numpy as np
import pytest
import torch
from livehand.backend.person.rig.rig_cameras import RigCameras, turn_costs, turned


def test_a_turned_camera_projects_as_its_record_does(made_rig):
    turn = np.array([0.02, -0.03, 0.01])
    stacked = RigCameras.of(made_rig.cameras, torch.float64)
    px, depth = stacked.project(torch.as_tensor(made_rig.points[0]), 3, torch.as_tensor(turn))
    wanted_px, wanted_depth = turned(made_rig.cameras[3], turn).project(made_rig.points[0])
    assert px.numpy() == pytest.approx(wanted_px, abs=1e-7)
    assert depth.numpy() == pytest.approx(wanted_depth)


def test_a_pan_moves_the_middle_by_the_focal_length(made_rig):
    camera = made_rig.cameras[0]
    middle = camera.origin + 0.5 * camera.cam2world[:3, 2]
    px = turned(camera, np.array([0, 0.01, 0])).project(middle[None])[0][0]
    assert px == pytest.approx(camera.K[:2, 2] + (camera.K[0, 0] * np.tan(0.01), 0))


def test_views_are_projected_at_once_as_one_by_one(made_rig):
    stacked = RigCameras.of(made_rig.cameras)
    points = torch.as_tensor(made_rig.points, dtype=torch.float32)
    turns = torch.linspace(-0.02, 0.02, 24).reshape(8, 3)
    rows = torch.tensor([6, 1])
    both = stacked.project_by_views(points, rows, turns)
    for at, row in enumerate(rows.tolist()):
        assert both[at].numpy() == pytest.approx(stacked.project(points[at], row, turns[row])[0].numpy(), abs=1e-3)


def test_a_metre_has_the_focal_length_over_the_depth(made_rig):
    points = torch.zeros(4, 3)
    assert RigCameras.of(made_rig.cameras).px_per_m(2, points) == pytest.approx(
        520 / np.linalg.norm(made_rig.cameras[2].origin), rel=1e-5
    )


def test_a_moved_camera_costs_hardly_more_and_roll_is_held():
    turns = torch.tensor([[0.0025, 0, 0], [0.02, 0, 0], [0.04, 0, 0], [0, 0, 0.0015], [0, 0, 0.03]])
    costs = turn_costs(turns)
    assert costs[0] == pytest.approx(0.5 / (1 + 1 / 9))
    assert costs[2] - costs[1] < 0.6 < costs[1]
    assert costs[3] == pytest.approx(0.5)
    assert costs[4] == pytest.approx(200.0)
