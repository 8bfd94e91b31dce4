"""Hands and cameras that are off come back by the outlines of all views."""

import numpy as np
import pytest
import torch
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.person.rig.landmark_pose import landmark_targets
from livehand.backend.person.rig.outline_fit import (
    RigFit,
    ViewOutlines,
    fitted_to_outlines,
    paired,
    picture_loss,
    reach_mm,
    with_turned_cameras,
)
from livehand.backend.person.rig.rig_cameras import RigCameras, turned

pytestmark = pytest.mark.slow

SCALES = [0.85] * 8


@pytest.fixture(scope="module")
def exact(made_rig):
    """The truth as a fit, the outlines that the truth shows, and rough landmarks."""
    hands, stacked = made_rig.hands, RigCameras.of(made_rig.cameras)
    fit = RigFit(hands.parameters(made_rig.poses), torch.zeros(8, 4))
    return fit, ViewOutlines.of(made_rig.labels(), SCALES), landmark_targets(made_rig.found(3.0), stacked)


def mean_error_m(rig, parameters):
    """Of the vertices of both hands without their arms."""
    poses = rig.hands.poses(parameters)
    found = np.stack([posed_arrays(rig.model, poses[side])[0] for side in rig.poses])
    off = np.linalg.norm(found - rig.vertices.reshape(found.shape), axis=-1)
    return off[:, rig.model.arm_weights < 0.5].mean()


def test_the_truth_costs_next_to_nothing_and_what_is_off_costs_more(made_rig, exact):
    fit, outlines, _ = exact
    stacked, hands = RigCameras.of(made_rig.cameras), made_rig.hands
    costs = []
    for shift in (0.0, 0.003):
        moved = fit._replace(parameters=fit.parameters._replace(transl=fit.parameters.transl + shift))
        pairs = paired(moved, hands, made_rig.cameras, outlines, range(8), 10.0)
        shown = hands.show(moved.parameters)
        costs.append(picture_loss(shown.all_vertices, shown.landmarks, moved.turns, stacked, pairs, None).item())
    assert costs[0] < 0.5
    assert costs[1] > 8 * costs[0]


def test_outlines_bring_hands_back(made_rig, exact):
    fit, outlines, targets = exact
    rng = torch.Generator().manual_seed(0)
    theta = fit.parameters.theta + 0.06 * torch.randn(2, 16, 3, generator=rng)
    start = fit._replace(
        parameters=fit.parameters._replace(theta=theta, beta=torch.zeros(10), transl=fit.parameters.transl + 0.004)
    )
    found = fitted_to_outlines(start, made_rig.hands, made_rig.cameras, outlines, targets, rounds=3)
    before, after = (mean_error_m(made_rig, one.parameters) for one in (start, found))
    assert before > 6e-3
    assert after < 3e-3


@pytest.mark.nightly
def test_a_moved_camera_is_turned_back_and_one_held_out_too(made_rig, exact):
    fit, outlines, targets = exact
    wrong = list(made_rig.cameras)
    wrong[1] = turned(wrong[1], np.array([0.0, 0.02, 0.0, 0.03]))
    wrong[6] = turned(wrong[6], np.array([0.015, 0.0, 0.0, 0.0]))
    found = fitted_to_outlines(fit, made_rig.hands, wrong, outlines, targets, held_out=[6], rounds=3)
    assert found.turns[1, :2].numpy() == pytest.approx((0, -0.02), abs=4e-3)
    assert found.turns[1, 3].item() == pytest.approx(-0.03, abs=6e-3)
    assert found.turns[6, 3] == 0
    assert found.turns[6, :2].numpy() == pytest.approx((-0.015, 0), abs=4e-3)
    assert mean_error_m(made_rig, found.parameters) < 2e-3


def test_outlines_before_a_bright_ground_have_no_pairs(made_rig, exact):
    fit, _, _ = exact
    labels = made_rig.labels()
    skin = [np.where((part > 0)[..., None], np.uint8(150), np.uint8(40)).repeat(3, -1) for part in labels]
    bright = np.where((labels[2] > 0)[..., None], np.uint8(150), np.uint8(250)).repeat(3, -1)
    pictures = [*skin[:2], bright, *skin[3:]]
    outlines = ViewOutlines.of(labels, SCALES, pictures)
    pairs = paired(fit, made_rig.hands, made_rig.cameras, outlines, range(8), 10.0)
    assert [part.view for part in pairs.views] == [0, 1, 3, 4, 5, 6, 7]


def test_held_out_views_move_no_hand(made_rig, exact):
    fit, outlines, targets = exact
    found = with_turned_cameras(fit, made_rig.hands, made_rig.cameras, outlines, targets, [2])
    assert torch.equal(found.parameters.theta, fit.parameters.theta)
    assert torch.equal(found.turns[[0, 1, 3, 4, 5, 6, 7]], torch.zeros(7, 4))
    assert found.turns[2].abs().max() < 4e-3
    assert with_turned_cameras(fit, made_rig.hands, made_rig.cameras, outlines, targets, []) is fit


def test_the_reach_of_pairs_shrinks_to_its_least():
    assert reach_mm(0) == 20
    assert reach_mm(1) == 15
    assert reach_mm(20) == 5
