"""Grasps: where a finger stops, limits, mirrored hands, refusals; and twenty of ten things, every night."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from livehand.backend.contact.grasp import Grasper, GraspOptions
from livehand.backend.contact.grasped_shot import grasped_shot
from livehand.backend.contact.pads import flat_pads
from livehand.backend.contact.placed_solids import PlacedSolid
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.gestures import GESTURES, FingerAxes, angles_of, theta_of
from livehand.backend.hand.joint_limits import usual_limits_deg
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.poses import POSES
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.tests.contact.things import HOLDS, given_pose, placed_mesh

pytestmark = pytest.mark.slow

AXES = FingerAxes.of_default_hand()


@pytest.fixture(scope="module")
def grasper(hand):
    return Grasper(hand, np.zeros(10))


def thing_of(mesh):
    return PlacedSolid.of(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def subdivided(vertices, faces):
    """The skin between the vertices, too."""
    return trimesh.remesh.subdivide(vertices, faces)[0]


def check_grasp(hand, grasp, given, thing):
    """What must hold of every grasp, measured by the posed model and not by the solver's own points."""
    own = hand.arm_weights == 0
    vertices = posed_vertices(hand, grasp.pose)
    depth_mm = -1000 * thing.distances(subdivided(vertices, hand.f[own[hand.f].all(1)])).signed_m
    assert depth_mm.max() <= 1.0
    joint = hand.lbs_weights.argmax(1)
    near = [np.abs(thing.distances(vertices[(joint - 1) // 3 == digit]).signed_m).min() for digit in range(5)]
    touching = [digit for digit in range(5) if 1000 * near[digit] <= 1.0 + 1e-9]
    assert 4 in touching
    assert len(touching) >= 3
    assert grasp.own_deepest_m <= 0.001
    assert not grasp.inside
    limits = np.deg2rad(usual_limits_deg(hand))
    was, angles = angles_of(given.theta, AXES), angles_of(grasp.pose.theta, AXES)
    assert (angles >= np.minimum(limits[:, 0], was) - 1e-4).all()
    assert (angles <= np.maximum(limits[:, 1], was) + 1e-4).all()
    np.testing.assert_array_equal(grasp.pose.theta[0], given.theta[0])
    np.testing.assert_array_equal(grasp.pose.transl, given.transl)


def check_it_stays(hand, grasper, grasp, thing):
    """A grasp of a hand that grasps changes nothing that anybody sees."""
    again = grasper.grasp(grasp.pose, [thing], GraspOptions())
    moved_m = np.linalg.norm(posed_vertices(hand, again.pose) - posed_vertices(hand, grasp.pose), axis=1)
    assert moved_m.max() < 1e-4
    turned = angles_of(again.pose.theta, AXES) - angles_of(grasp.pose.theta, AXES)
    assert np.rad2deg(np.abs(turned)).max() < 0.1


def check_last_joints(grasp, given):
    """A finger's last joint is not bent by itself: that is a claw."""
    was, flexion = (np.rad2deg(angles_of(pose.theta, AXES)[:12, 0]).reshape(4, 3) for pose in (given, grasp.pose))
    assert (flexion[:, 2] < np.maximum(flexion[:, 1] * 2 / 3 + 10, was[:, 2]) + 15).all()


def held(hand, number):
    return given_pose(HOLDS[number]), thing_of(placed_mesh(HOLDS[number], hand))


@pytest.mark.slow
@pytest.mark.parametrize("number", [0, 12])
def test_a_ball_and_a_handle_are_grasped(hand, grasper, number):
    given, thing = held(hand, number)
    grasp = grasper.grasp(given, [thing], GraspOptions())
    check_grasp(hand, grasp, given, thing)
    check_it_stays(hand, grasper, grasp, thing)


@pytest.mark.nightly
@pytest.mark.parametrize("number", range(len(HOLDS)))
def test_twenty_grasps_of_ten_things(hand, grasper, number):
    given, thing = held(hand, number)
    grasp = grasper.grasp(given, [thing], GraspOptions())
    check_grasp(hand, grasp, given, thing)
    check_it_stays(hand, grasper, grasp, thing)
    check_last_joints(grasp, given)


def test_a_finger_stops_where_it_meets_a_wall(hand, grasper):
    """A wall that the index finger's skin reaches at a third of the way to a fist."""
    bent = np.zeros((15, 3))
    bent[:3, 0] = 0.33 * GESTURES["fist"].angles_deg()[:3, 0]
    is_index = hand.lbs_weights[:, 1:4].sum(1) > 0.5
    floor_m = posed_vertices(hand, HandPose(theta_of(bent, AXES), np.zeros(10), np.zeros(3)))[is_index, 1].min()
    wall = trimesh.creation.box((0.3, 0.02, 0.4)).apply_translation((-0.15, floor_m - 0.01, 0.0))
    options = GraspOptions(("index",), press_m=0.0, reach_m=0.0)
    grasp = grasper.grasp(HandPose.rest(), [thing_of(wall)], options)
    assert abs(grasp.gaps_m["index"]) < 0.0004
    np.testing.assert_allclose(grasp.pose.theta[4:], 0, atol=1e-12)
    np.testing.assert_allclose(np.rad2deg(angles_of(grasp.pose.theta, AXES)[:3, 0]), bent[:3, 0], atol=3)


def test_the_proximal_joint_stops_at_a_bar_and_the_others_go_on(hand, grasper):
    """A bar under the first phalanges; the wall test's fingers end at their tips instead."""
    bar = trimesh.creation.cylinder(0.006, 0.12, sections=32).apply_translation((-0.022, -0.022, 0.0))
    grasp = grasper.grasp(HandPose.rest(), [thing_of(bar)], GraspOptions(("middle",), reach_m=0.0))
    flexion = np.rad2deg(angles_of(grasp.pose.theta, AXES)[3:6, 0])
    assert flexion[0] < 30
    assert flexion[1] > 55
    assert "middle" in grasp.touches


def test_a_left_hand_grasps_as_its_mirror_image(hand, grasper):
    given, thing = held(hand, 0)
    right = grasper.grasp(given, [thing], GraspOptions())
    left = grasper.grasp(given.mirrored(), [thing.mirrored()], GraspOptions())
    assert left.pose.side == "left"
    np.testing.assert_array_equal(left.pose.theta, right.pose.mirrored().theta)
    assert left.gaps_m == right.gaps_m


def test_a_turned_and_moved_hand_grasps_alike(hand, grasper):
    given, thing = held(hand, 0)
    turn, place = axis_angle_to_matrix(np.array([0.4, -0.9, 0.3])), np.array([0.1, -0.3, 0.2])
    wrist = hand.joints[0]
    away = replace(given, theta=np.vstack([[[0.4, -0.9, 0.3]], given.theta[1:]]), transl=place)
    there = thing.moved(turn, wrist + place - turn @ wrist)
    one, other = (grasper.grasp(*row, GraspOptions()) for row in ((given, [thing]), (away, [there])))
    np.testing.assert_allclose(other.pose.theta[1:], one.pose.theta[1:], atol=2e-3)


def test_a_hand_that_reaches_nothing_or_is_inside_is_told(hand, grasper):
    given, thing = held(hand, 0)
    with pytest.raises(LiveHandError, match=r"a finger must reach the object; the nearest, the \w+, ends \d+ mm away"):
        grasper.grasp(given, [thing.moved(np.eye(3), np.array([0, -0.4, 0]))], GraspOptions())
    inside = thing.moved(np.eye(3), np.array([0, 0.004, 0]))
    with pytest.raises(LiveHandError, match=r"the palm must not be inside the object, it is 3\.\d mm deep"):
        grasper.grasp(given, [inside], GraspOptions())
    moved = grasper.grasp(given, [inside], GraspOptions(moves_wrist=True))
    assert 0.002 < np.linalg.norm(moved.pose.transl) < 0.006
    assert moved.deepest_m <= 0.001
    with pytest.raises(LiveHandError, match="fingers must be some of"):
        grasper.grasp(given, [thing], GraspOptions(()))
    with pytest.raises(LiveHandError, match="the press must be 0 to 1 mm"):
        grasper.grasp(given, [thing], GraspOptions(press_m=0.002))


@pytest.mark.parametrize("side", ["right", "left"])
def test_pads_flatten_to_the_surface_and_the_rest_of_the_hand_stays(hand, grasper, side):
    given, thing = held(hand, 0)
    grasp = grasper.grasp(given, [thing], GraspOptions(press_m=0.001))
    pose, thing = (grasp.pose, thing) if side == "right" else (grasp.pose.mirrored(), thing.mirrored())
    own = hand.for_side(side)
    vertices, pads = posed_vertices(own, pose), flat_pads(hand, pose, [thing])
    before, after = (thing.distances(one).signed_m for one in (vertices, vertices + pads.offsets))
    assert before.min() < -0.0004
    assert after.min() > -1e-5
    assert (pads.pressed_m[before > 0.003] == 0).all()
    np.testing.assert_allclose(np.linalg.norm(pads.offsets, axis=1), pads.pressed_m, atol=1e-9)
    as_key = replace(own, v_template=own.v_template + pads.rest_offsets, J_regressor=own.J_regressor * 0)
    shifted = posed_vertices(replace(as_key, J_regressor=_regressor(own, as_key)), pose)
    np.testing.assert_allclose(shifted - vertices, pads.offsets, atol=1e-6)


def _regressor(own, changed):
    """One that finds the unchanged joints in the changed template: a shape key moves no bones."""
    return own.joints @ np.linalg.pinv(changed.v_template)


@pytest.mark.nightly
def test_over_a_shot_nothing_pops(hand, grasper):
    """A cylinder comes, is grasped and turned in the hand; from frame to frame joints move hardly more than given."""
    base = thing_of(placed_mesh(HOLDS[3], hand))
    start, end = (POSES[name].gesture.angles_deg() for name in ("Open", "Relaxed"))
    poses, things = [], []
    for frame in range(36):
        share = 0.4 * np.sin(np.pi * frame / 35)
        poses.append(HandPose(theta_of(start + share * (end - start), AXES), np.zeros(10), np.zeros(3)))
        away = np.array([0, -0.004 - max(0, 0.2 * (1 - frame / 12)), 0])
        things.append([base.moved(axis_angle_to_matrix(np.array([0, 0.1 * np.sin(frame / 9), 0])), away)])
    found = grasped_shot(grasper, poses, things, GraspOptions())
    thetas = np.stack([one.pose.theta[1:] for one in found])
    turned_deg = np.rad2deg(np.linalg.norm(np.diff(thetas, axis=0), axis=2))
    assert turned_deg.max() < 20  # as the fingers close
    assert turned_deg[20:].max() < 2  # while they hold
    assert all(one.deepest_m <= 0.001 for one in found)
    assert all(len(one.touches) == 5 for one in found[18:])
    assert not found[0].touches
