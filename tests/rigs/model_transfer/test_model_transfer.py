"""Another model's poses as the built-in hand's: against a twin whose every vertex and angle is known."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.mesh_tables import area_weighted_normals
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.poses import sample_poses_deg
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.rigs.model_transfer.model_transfer import ModelTransfer
from livehand.backend.rigs.model_transfer.region_mesh import RegionMesh, vertex_regions

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def poses():
    rng = np.random.default_rng(3)
    beta = rng.normal(0, 0.7, 10)
    angles = sample_poses_deg(rng, 3)
    theta = [theta_of(each, FingerAxes.of_default_hand(), rng.normal(0, 0.8, 3)) for each in angles]
    return [HandPose(each, beta, rng.normal(0, 0.2, 3)) for each in theta]


@pytest.fixture(scope="module")
def carried(transfer, poses):
    return transfer.transferred(poses)


def surface(hand, pose, offset_m):
    vertices = posed_vertices(hand, pose)
    return vertices + offset_m[:, None] * area_weighted_normals(vertices, hand.f)


def test_both_are_one_surface_in_every_pose(hand, twin, poses, carried):
    for pose, ours in zip(poses, carried.poses, strict=True):
        mesh = RegionMesh.of(hand, surface(hand, ours, carried.offset_m))
        off_m = mesh.nearest(posed_vertices(twin.model, pose), vertex_regions(twin.model)).distance_m
        assert np.median(off_m) < 0.0004
        assert np.quantile(off_m, 0.95) < 0.0025
    assert carried.deviation_mm.max() < 1.6


def test_every_spot_of_skin_is_where_it_was(hand, twin, poses, carried):
    for pose, ours in zip(poses, carried.poses, strict=True):
        at = surface(hand, ours, carried.offset_m)[twin.vertex]
        off_m = np.linalg.norm(at - posed_vertices(twin.model, pose), axis=1)
        assert np.median(off_m) < 0.0013
        assert np.quantile(off_m, 0.95) < 0.0042


def test_joints_point_where_they_did(hand, twin, poses, carried):
    """Twists of round fingers aside, which surfaces hardly tell: bones' directions."""
    bones = FingerAxes.of_default_hand().bone[1:]
    for pose, ours in zip(poses, carried.poses, strict=True):
        truth = world(pose.theta) @ world(twin.rest.theta)
        directions = [np.einsum("jab,jb->ja", each[1:], bones) for each in (truth, world(ours.theta))]
        degrees = np.rad2deg(np.arccos((directions[0] * directions[1]).sum(1).clip(-1, 1)))
        assert degrees.mean() < 5
        turn = truth[0].T @ world(ours.theta)[0]
        assert np.rad2deg(np.linalg.norm(matrix_to_axis_angle(turn))) < 1.5


def test_the_arm_goes_on_straight_and_all_poses_have_one_shape(carried):
    assert all(not pose.forearm.any() for pose in carried.poses)
    assert len({tuple(pose.beta) for pose in carried.poses}) == 1
    assert np.abs(carried.offset_m).max() <= 0.004


def test_betas_become_ours(twin, transfer):
    """How a beta of the twin moves the skin, the built-in hand's beta and offsets move it, too."""
    mean, offset_m = transfer.shape(np.zeros(10))
    before = surface(transfer.ours, mean, offset_m)[twin.vertex]
    for beta in (1.5 * twin.mixed[0], -1.5 * twin.mixed[4]):
        pose, offset_m = transfer.shape(beta)
        moved = surface(transfer.ours, pose, offset_m)[twin.vertex] - before
        truth = twin.model.shapedirs @ beta
        left = np.linalg.norm(moved - truth, axis=1)
        assert left.mean() < 0.3 * np.linalg.norm(truth, axis=1).mean()


def test_a_left_hand_is_the_mirror_image(hand, twin, transfer, poses, carried):
    mirrored = replace(transfer, other=twin.model.for_side("right"))
    assert mirrored.transferred(poses[:1]).poses[0].theta == pytest.approx(carried.poses[0].theta, abs=0.05)
    with pytest.raises(LiveHandError, match="of one side, got right and left"):
        ModelTransfer.of(hand, twin.model.for_side("left"))
    with pytest.raises(LiveHandError, match="poses must be of the model's side, right"):
        transfer.transferred([poses[0].mirrored()])


def test_what_is_no_hand_is_refused(hand, twin):
    inches = replace(twin.model, v_template=twin.model.v_template * 39.37)
    with pytest.raises(LiveHandError, match="it seems to be in inches"):
        ModelTransfer.of(hand, inches)
    normals = area_weighted_normals(twin.model.v_template, twin.model.f)
    swollen = replace(twin.model, name="ball", v_template=twin.model.v_template + 0.03 * normals)
    with pytest.raises(LiveHandError, match="'ball' must be a hand that the built-in one can be laid over"):
        ModelTransfer.of(hand, swollen)


def world(theta):
    """The joints' rotations in the world, by an independent walk along the tree."""
    parents, found = (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14), []
    for local, above in zip(axis_angle_to_matrix(theta), parents, strict=True):
        found.append(local if above < 0 else found[above] @ local)
    return np.array(found)
