"""Poses and shape are found from where vertices should be; the optimum is that of a slow descent."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.joint_limits import FREE
from livehand.backend.hand.lbs import SkinTensors, pose_hand, posed_vertices
from livehand.backend.hand.measurements import length_and_breadth_m
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.person.fit.pose_fit import fitted_poses, robust, stiff_turns
from livehand.backend.person.fit.pose_targets import OutlineTargets, PoseTargets
from livehand.backend.records.camera import Camera
from livehand.backend.records.hand_picture import HAND, HandPicture
from livehand.backend.records.shot import HandPose

CAMERA = Camera(np.array([[900.0, 0, 200], [0, 900, 200], [0, 0, 1]]), np.eye(4), (400, 400))
BETA = np.array([0.4, -0.5, 0.3, 0, 0.2, 0, 0, 0.1, 0, 0])


@pytest.fixture(scope="module")
def hand():
    return load_default_hand()


def _pose(rng, turn=0.0):
    theta = theta_of(rng.uniform(0, 25, (15, 3)) * [1, 0, 0], FingerAxes.of_default_hand(), np.array([turn, 0.3, 0]))
    return HandPose(theta, BETA, np.array([0.08, 0, 0.45]), "right", rng.uniform(-0.1, 0.1, 3))


def _targets(hand, pose, rng):
    """Where half of the vertices are; and others, at an outline, by their distance across it alone."""
    px = CAMERA.project(posed_vertices(hand, pose))[0]
    weight = np.where(np.arange(len(px)) % 2 == 0, 1.0, 0.0)
    edge = np.arange(1, len(px), 40)
    angle = rng.uniform(0, 2 * np.pi, len(edge))
    normal = np.stack([np.cos(angle), np.sin(angle)], 1)
    along = rng.uniform(-3, 3, len(edge))[:, None] * normal[:, ::-1] * [1, -1]
    outline = OutlineTargets(edge, px[edge] + along, normal)
    return PoseTargets(px, weight, np.tile(np.eye(2), (len(px), 1, 1)), outline, 0.0, 1.0)


def _with_edges(targets, rng, share):
    """Along a direction of its own, each vertex counts by a share alone; it is off there, mostly downwards."""
    angle = rng.uniform(0, np.pi, len(targets.px))
    along = np.stack([np.cos(angle), np.sin(angle)], 1)
    reliability = np.eye(2) - (1 - share) * along[:, :, None] * along[:, None]
    return targets._replace(px=targets.px + 12 * rng.random((len(along), 1)) * along, reliability=reliability)


@pytest.fixture(scope="module")
def film(hand):
    """Three pictures that begin beside their poses, in another shape, with the true poses and what they want."""
    rng = np.random.default_rng(5)
    true = [_pose(rng, turn) for turn in (-0.5, 0.1, 0.6)]
    off = np.where(np.isin(np.arange(45), FREE), 0.05, 0).reshape(15, 3)
    begun = [
        replace(
            pose,
            theta=pose.theta + np.concatenate([[[0.04, -0.03, 0.05]], rng.uniform(-1, 1, (15, 3)) * off]),
            beta=np.zeros(10),
            transl=pose.transl + rng.uniform(-0.004, 0.004, 3),
        )
        for pose in true
    ]
    blank = np.zeros((400, 400, 3), np.uint8)
    pictures = [HandPicture(str(k), blank, np.full((400, 400), HAND, np.uint8), CAMERA, p) for k, p in enumerate(begun)]
    return pictures, true, [_targets(hand, pose, rng) for pose in true]


def _nothing(pictures, hand):
    return [np.zeros_like(hand.v_template) for _ in pictures]


def test_poses_and_shape_come_back(hand, film):
    pictures, true, targets = film
    length_m = float(length_and_breadth_m(hand, BETA)[0])  # a smaller hand that is nearer looks much the same
    found = fitted_poses(hand, pictures, targets, _nothing(pictures, hand), length_m=length_m)
    for before, pose, wanted in zip(pictures, found, true, strict=True):
        px, goal, start = (CAMERA.project(posed_vertices(hand, one))[0] for one in (pose, wanted, before.pose))
        assert np.linalg.norm(start - goal, axis=1).mean() > 5
        assert np.linalg.norm(px - goal, axis=1).mean() < 0.4  # priors hold it back by so much
        np.testing.assert_allclose(pose.beta, found[0].beta)
    off_mm = [
        1000 * np.linalg.norm(hand.shapedirs @ (beta - BETA), axis=1).mean() for beta in (found[0].beta, 0 * BETA)
    ]
    assert off_mm[0] < 0.4 * off_mm[1]


def test_the_optimum_is_that_of_a_slow_descent(hand, film):
    """The same cost, written down once more, hardly falls by 150 steps of gradient descent from there."""
    pictures, _, targets = film
    rng = np.random.default_rng(3)
    targets = [_with_edges(each, rng, 0.3) for each in targets]
    found = fitted_poses(hand, pictures, targets, _nothing(pictures, hand))
    skin, stiff = SkinTensors.of(hand), stiff_turns(hand)
    goal, weight, reliability = (
        torch.as_tensor(np.stack(values)).float()
        for values in zip(*((t.px, t.weight, t.reliability) for t in targets), strict=True)
    )
    edges = [torch.as_tensor(np.stack(values)) for values in zip(*(t.outline for t in targets), strict=True)]
    K = torch.as_tensor(CAMERA.K).float()

    def stacked(poses):
        rows = [[getattr(pose, name) for pose in poses] for name in ("theta", "transl", "forearm")]
        return [torch.as_tensor(np.stack(values)).float() for values in rows]

    start = stacked([picture.pose for picture in pictures])

    def cost(theta, transl, forearm, beta):
        homogeneous = pose_hand(skin, theta, beta.expand(3, 10), transl, forearm).vertices @ K.T
        px = homogeneous[..., :2] / homogeneous[..., 2:]
        inside = (weight * robust((reliability @ (px - goal)[..., None]).norm(dim=(-2, -1)))).sum(1) / weight.sum(1)
        at_edge = torch.stack([view[rows] for view, rows in zip(px, edges[0], strict=True)])
        across = ((at_edge - edges[1]) * edges[2]).sum(-1)
        off = (6.0 * (theta - start[0])[:, 1:] ** 2).sum((1, 2)) + 30.0 * ((theta.flatten(1) @ stiff.T) ** 2).sum(1)
        off = off + 0.5 * (((transl - start[1]) / 0.04) ** 2).sum(1) + 0.5 * (((forearm - start[2]) / 0.4) ** 2).sum(1)
        return inside.mean() + 0.5 * robust(across).mean() + off.mean() + 0.15 * (beta**2).sum()

    values = [each.requires_grad_(True) for each in (*stacked(found), torch.as_tensor(found[0].beta).float())]
    first = float(cost(*values).detach())
    optimiser = torch.optim.Adam(values, 2e-4)
    for _ in range(150):
        optimiser.zero_grad()
        cost(*values).backward()
        optimiser.step()
    assert float(cost(*(each.detach() for each in (*start, torch.zeros(10))))) > 3 * first
    assert first - float(cost(*values).detach()) < 0.01 * first


def test_places_along_edges_do_not_count(hand, film):
    pictures, true, targets = film
    rng = np.random.default_rng(4)
    slid = [_with_edges(replace_px(each, each.px), rng, 0.0) for each in targets]
    found = fitted_poses(hand, pictures, slid, _nothing(pictures, hand))
    for pose, wanted in zip(found, true, strict=True):
        px, goal = (CAMERA.project(posed_vertices(hand, one))[0] for one in (pose, wanted))
        assert np.linalg.norm(px - goal, axis=1).mean() < 0.5


def test_what_is_held_out_does_not_move_the_shape(hand, film):
    pictures, _, targets = film
    held_out = [replace(picture, is_held_out=index == 2) for index, picture in enumerate(pictures)]
    targets = [replace_px(each, each.px) for each in targets]
    wrong = [*targets[:2], replace_px(targets[2], targets[2].px + np.array([9, -4]))]
    found = [fitted_poses(hand, held_out, some, _nothing(pictures, hand)) for some in (targets, wrong)]
    np.testing.assert_allclose(found[0][0].beta, found[1][0].beta, atol=8e-3)  # steps end where they gain little
    moved = [CAMERA.project(posed_vertices(hand, poses[2]))[0] for poses in found]
    np.testing.assert_allclose((moved[1] - moved[0]).mean(0), [9, -4], atol=1.5)


def replace_px(targets, px):
    none = OutlineTargets(np.zeros(0, int), np.zeros((0, 2)), np.zeros((0, 2)))
    return targets._replace(px=px, outline=none)


def test_the_shape_may_rest_and_moments_share_their_pose(hand, film):
    pictures, _, targets = film
    found = fitted_poses(hand, pictures, targets, _nothing(pictures, hand), fits_shape=False)
    np.testing.assert_allclose(found[0].beta, 0, atol=1e-7)
    shared = [replace(picture, pose=pictures[0].pose, moment=4) for picture in pictures]
    one = fitted_poses(hand, shared, [targets[0]] * 3, _nothing(pictures, hand))
    assert one[0] is one[1] is one[2]


def test_a_persons_own_shape_is_added(hand, film):
    """Vertices that an offset puts right need no other pose."""
    pictures, true, targets = film
    posed = [replace(picture, pose=pose) for picture, pose in zip(pictures, true, strict=True)]
    offset_m = np.random.default_rng(2).normal(0, 0.002, hand.v_template.shape)
    shifted = [
        replace_px(each, CAMERA.project(posed_vertices(hand, pose) + offset_m)[0])
        for each, pose in zip(targets, true, strict=True)
    ]
    found = fitted_poses(hand, posed, shifted, [offset_m] * 3)
    for pose, wanted in zip(found, true, strict=True):
        off_mm = 1000 * np.linalg.norm(posed_vertices(hand, pose) - posed_vertices(hand, wanted), axis=1)
        assert off_mm.mean() < 0.5  # the hinges' prior moves it a little


def test_fingers_of_which_nothing_is_seen_bend_as_landmarks_told(hand, film):
    """Where they begin does not matter then; the wrist follows the picture."""
    pictures, true, targets = film
    is_palm = hand.lbs_weights[:, 0] > 0.9
    palms = [replace_px(each._replace(weight=each.weight * is_palm), each.px) for each in targets]
    told = [replace(pose, theta=0.7 * pose.theta) for pose in true]
    pictures = [replace(picture, sighted=pose) for picture, pose in zip(pictures, told, strict=True)]
    found = fitted_poses(hand, pictures, palms, _nothing(pictures, hand), fits_shape=False)
    for pose, wanted, begun in zip(found, told, pictures, strict=True):
        assert np.abs(begun.pose.theta[1:] - wanted.theta[1:]).max() > 0.1
        np.testing.assert_allclose(pose.theta[1:], wanted.theta[1:], atol=0.02)
    wrists = [pose.theta[0] - one.theta[0] for pose, one in zip(found, told, strict=True)]
    assert np.linalg.norm(wrists, axis=1).min() > 0.05


def test_a_known_length_is_kept(hand, film):
    pictures, _, targets = film
    found = fitted_poses(hand, pictures, targets, _nothing(pictures, hand), length_m=0.2)
    assert length_and_breadth_m(hand, found[0].beta)[0] == pytest.approx(0.2, abs=0.002)


def test_turns_that_hinges_do_not_allow_are_told_and_free_ones_are_not(hand):
    free, stiff = np.zeros((2, 45))
    free[FREE] = 20.0
    stiff[np.setdiff1d(np.arange(45), FREE)] = 4.0
    angles_deg = np.stack([free, stiff]).reshape(2, 15, 3)
    theta = theta_of(angles_deg, FingerAxes.of_default_hand(), np.array([0.5, 0.2, -0.3]))
    turns = torch.as_tensor(theta, dtype=torch.float32).flatten(1) @ stiff_turns(hand).T
    turns_deg = np.rad2deg(turns.numpy())
    # Turns about several axes at once differ from their sum by half of their products: .5 x 20 x 20 deg at a knuckle.
    assert np.abs(turns_deg[0]).max() < 0.5 * np.rad2deg(np.deg2rad(20) ** 2) + 0.2
    np.testing.assert_allclose(turns_deg[1], 4.0, atol=0.5 * np.rad2deg(np.deg2rad(4) ** 2) + 0.02)
