"""Our hand follows another rig: the identity on itself, invariances, known differences at rest, and directions."""

import runpy
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import JOINT_NAMES, MIRROR_AXIS_ANGLE, PARENTS
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.motion import mirrored
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.doubts import motion_doubts, rest_doubts
from livehand.backend.rigs.rest_alignment import align
from livehand.backend.rigs.retarget import SourceMotion, retarget
from livehand.backend.rigs.shape_fit import HandShape, fit_shape, rest_nodes
from livehand.backend.rigs.source_skeleton import JointMap

LIB = runpy.run_path(str(Path(__file__).parent / "skeletons.py"))
hand_bones, skeleton = LIB["hand_bones"], LIB["skeleton"]
TIPS = tuple(f"tip{k}" for k in range(5))
MEAN = HandShape(np.zeros(10), 1.0)


def joint_map(side, tips=TIPS):
    return JointMap(side, JOINT_NAMES, tips)


def ours_elsewhere(side, seed=0, rest_theta=None, beta=None, scale=1.0, tips=TIPS):
    """A rig of our own hand in some rest pose, with random rolls, size and place: (skeleton, pose function)."""
    rng = np.random.default_rng(seed)
    model = load_default_hand().for_side(side)
    nodes = rest_nodes(model, np.zeros(10) if beta is None else beta)
    resting = forward(nodes, np.zeros((16, 3)) if rest_theta is None else rest_theta)
    place = axis_angle_to_matrix(rng.normal(size=3)), rng.normal(size=3)
    names = [*JOINT_NAMES, *(tip for tip in tips if tip)]
    kept = [0, *(1 + 4 * f + k for f in range(5) for k in range(3)), *(4 * f + 4 for f in range(5) if tips[f])]
    parents = [JOINT_NAMES[PARENTS[j]] if j else None for j in range(16)] + [None] * (len(names) - 16)
    bones = [(name, parent, resting[1][k]) for name, parent, k in zip(names, parents, kept, strict=True)]
    rest = skeleton(bones, place[0], scale, place[1], rng)

    def posed(thetas):
        turns = [
            np.einsum("ab,jbc,jdc,ed->jae", place[0], forward(nodes, theta)[0], resting[0], place[0])
            for theta in thetas
        ]
        return SourceMotion(np.array(turns) @ rest.frames[:16], np.tile(rest.heads[0], (len(thetas), 1)), 24.0, side)

    return rest, posed, place[0], place[1]


def forward(nodes, theta):
    """Turns [16, 3, 3] and nodes [21, 3] of a pose, about the wrist's joint."""
    turns, points = list(axis_angle_to_matrix(theta)), [nodes[0]]
    for joint in range(1, 16):
        turns[joint] = turns[PARENTS[joint]] @ turns[joint]
    for finger in range(5):
        chain = [turns[0], *turns[3 * finger + 1 : 3 * finger + 4]]
        steps = np.diff([nodes[0], *nodes[4 * finger + 1 : 4 * finger + 5]], axis=0)
        points += list(nodes[0] + np.cumsum([turn @ step for turn, step in zip(chain, steps, strict=True)], 0))
    return np.array(turns), np.array(points)


def gesture(name, side="right", root=(0.2, -0.4, 0.6)):
    theta = theta_of(GESTURES[name].angles_deg(), FingerAxes.of_default_hand(), np.array(root))
    return theta if side == "right" else theta * MIRROR_AXIS_ANGLE


def in_world(thetas, turn):
    thetas = thetas.copy()
    thetas[:, 0] = matrix_to_axis_angle(turn @ axis_angle_to_matrix(thetas[:, 0]))
    return thetas


def apart_deg(a, b):
    turn = axis_angle_to_matrix(a).swapaxes(-1, -2) @ axis_angle_to_matrix(b)
    return np.rad2deg(np.linalg.norm(matrix_to_axis_angle(turn), axis=-1))


@pytest.mark.slow
@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_our_own_hand_onto_itself_is_the_identity_for_any_roll_and_place(hand, side, seed):
    model = hand
    rest, posed, turn, shift = ours_elsewhere(side, seed)
    thetas = np.random.default_rng(seed).normal(size=(4, 16, 3)) * 0.6
    motion = retarget(posed(thetas), align(rest, joint_map(side), model))
    np.testing.assert_allclose(motion.theta, in_world(thetas, turn), atol=1e-6)
    np.testing.assert_allclose(motion.beta, 0, atol=1e-4)
    wrist = rest_wrists(model.for_side(side), np.zeros(10))
    np.testing.assert_allclose(motion.transl, np.tile(turn @ wrist + shift - wrist, (4, 1)), atol=1e-6)
    assert (motion.side, motion.fps) == (side, 24.0)


@pytest.mark.slow
def test_tips_are_ignored_if_all_joints_coincide(hand):
    """A rig's tip bones stand where it likes, and a model's own tips are vertices: neither is part of the rest pose."""
    rest, posed, turn, _ = ours_elsewhere("right", 4, scale=0.01)
    heads = rest.heads.copy()
    heads[16:] += np.random.default_rng(4).normal(size=(5, 3)) * 0.004 * 0.01
    thetas = np.random.default_rng(5).normal(size=(4, 16, 3)) * 0.6
    alignment = align(replace(rest, heads=heads), joint_map("right"), hand)
    assert alignment.shape.scale == pytest.approx(0.01, rel=1e-9)
    np.testing.assert_array_equal(alignment.shape.beta, 0)
    np.testing.assert_allclose(retarget(posed(thetas), alignment).theta, in_world(thetas, turn), atol=1e-6)


@pytest.mark.slow
def test_units_and_the_place_of_the_object_do_not_matter(hand):
    thetas = np.array([gesture(name) for name in ("fist", "pinch", "point")])
    results = []
    for scale in (0.01, 1.0, 100.0):
        rest, posed, *_ = ours_elsewhere("right", 3, gesture("spread", root=(0, 0, 0)), scale=scale)
        alignment = align(rest, joint_map("right"), hand)
        assert alignment.shape.scale == pytest.approx(scale, rel=1e-4)
        results.append(retarget(posed(thetas), alignment).theta)
    np.testing.assert_allclose(results[0], results[1], atol=1e-6)
    np.testing.assert_allclose(results[2], results[1], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["open", "spread", "relaxed", "fist"])
@pytest.mark.parametrize("side", ["right", "left"])
def test_another_rest_pose_of_our_hand_makes_little_difference(hand, name, side):
    """Directions are exact; how far a bone is turned about itself is told by the bones' places only, so nearly."""
    rest, posed, turn, _ = ours_elsewhere(side, 1, gesture(name, side, (0, 0, 0)))
    thetas = np.array([gesture(other, side) for other in ("rest", "fist", "pinch", "point", "spread")])
    motion = retarget(posed(thetas), align(rest, joint_map(side), hand, MEAN))
    nodes = rest_nodes(hand.for_side(side), np.zeros(10))
    for theta, wanted in zip(motion.theta, in_world(thetas, turn), strict=True):
        np.testing.assert_allclose(forward(nodes, theta)[1], forward(nodes, wanted)[1], atol=1e-6)
    off = apart_deg(motion.theta, in_world(thetas, turn))
    assert off[:, :13].max() < 10  # of the fist, whose fingers lie spread beside each other
    assert off[:, 13:].max() < (1 if name in ("open", "spread") else 25)


def test_bones_point_where_theirs_do_whatever_both_hands_are(hand):
    """A hand of other proportions, bent at random: every bone but the palm's has the direction of its source."""
    rng = np.random.default_rng(5)
    rest, posed, *_ = ours_elsewhere("right", 5, rng.normal(size=(16, 3)) * 0.3, rng.normal(size=10) * 2)
    thetas = rng.normal(size=(3, 16, 3)) * 0.7
    alignment = align(rest, joint_map("right"), hand)
    source = posed(thetas)
    motion = retarget(source, alignment)
    nodes = rest_nodes(hand, alignment.shape.beta)
    for frame in range(3):
        turned = source.frames[frame] @ rest.frames[:16].swapaxes(1, 2)
        points = forward(nodes, motion.theta[frame])[1]
        for finger in range(5):
            heads = np.array([*rest.heads[3 * finger + 1 : 3 * finger + 4], rest.heads[16 + finger]])
            theirs = np.einsum("kab,kb->ka", turned[3 * finger + 1 : 3 * finger + 4], np.diff(heads, axis=0))
            own = np.diff(points[4 * finger + 1 : 4 * finger + 5], axis=0)
            cosines = (theirs * own).sum(1) / np.linalg.norm(theirs, axis=1) / np.linalg.norm(own, axis=1)
            np.testing.assert_allclose(cosines, 1, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["right", "left"])
def test_a_rest_pose_that_is_no_hands_is_not_taken_for_one(hand, side):
    """Fingers that point anywhere at rest: the joints' places in each frame tell how bones are turned."""
    rest_theta = np.random.default_rng(0).normal(size=(16, 3))
    rest_theta[0] = 0
    rest, posed, turn, _ = ours_elsewhere(side, 1, rest_theta)
    thetas = np.array([gesture(name, side) for name in ("rest", "fist", "pinch", "point", "spread")])
    nodes = rest_nodes(hand.for_side(side), np.zeros(10))
    wanted = in_world(thetas, turn)
    points = np.array([forward(nodes, theta)[1] for theta in wanted]) - nodes[0] + rest.heads[0]
    source = replace(posed(thetas), nodes=points, ends=np.full((5, 5, 3), np.nan))
    alignment = align(rest, joint_map(side), hand, MEAN)
    motion = retarget(source, alignment)
    found = np.array([forward(nodes, theta)[1] for theta in motion.theta]) + motion.transl[:, None]
    np.testing.assert_allclose(found, points, atol=1e-6)
    off = apart_deg(motion.theta, wanted)
    assert off[:, :13].max() < 10  # of the fist, whose fingers lie spread beside each other
    assert off[:, 13:].max() < 25
    assert motion_doubts(alignment, motion) is None
    assert "beyond what a hand can" in motion_doubts(alignment, retarget(replace(source, nodes=None), alignment))


def without(names, skeleton_, map_):
    """A rig and its map without some joints."""
    bones = tuple(None if name in names else name for name in map_.bones)
    return skeleton_, JointMap(map_.side, bones, tuple(None if tip in names else tip for tip in map_.tips))


@pytest.mark.slow
@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize(
    "gone",
    [("pinky3",), ("pinky3", "tip2"), ("ring1", "ring2", "ring3", "tip3"), ("index2",), ("thumb1",)],
    ids=str,
)
def test_joints_that_the_rig_lacks_stay_at_rest(hand, side, gone):
    rest, posed, turn, _ = ours_elsewhere(side, 1)
    thetas = np.array([gesture(name, side) for name in ("fist", "pinch")])
    rig, kept = without(gone, rest, joint_map(side))
    alignment = align(rig, kept, hand)
    motion = retarget(_driven(posed(thetas), kept), alignment)
    lacking = [JOINT_NAMES.index(name) for name in gone if name in JOINT_NAMES]
    np.testing.assert_allclose(alignment.shape.scale, 1, rtol=0.02)
    np.testing.assert_allclose(np.ptp(motion.theta[:, lacking], axis=0), 0, atol=1e-6)
    np.testing.assert_allclose(motion.theta[:, lacking], 0, atol=0.25)  # between two known joints, a finger is straight
    fingers = {(joint - 1) // 3 for joint in lacking}
    others = [joint for joint in range(16) if joint == 0 or (joint - 1) // 3 not in fingers]
    np.testing.assert_allclose(motion.theta[:, others], in_world(thetas, turn)[:, others], atol=0.02)
    assert f"no bones for {', '.join(name for name in gone if name in JOINT_NAMES)}, which" in rest_doubts(alignment)


def _driven(source, map_):
    rows = [JOINT_NAMES.index(name) for name in map_.drivers]
    return replace(source, frames=source.frames[:, rows])


@pytest.mark.slow
def test_bones_that_are_no_hands_are_doubted(hand):
    rest, *_ = ours_elsewhere("right", 2)
    assert rest_doubts(align(rest, joint_map("right"), hand)) is None
    swapped = list(JOINT_NAMES)
    swapped[1:4], swapped[13:] = JOINT_NAMES[13:], JOINT_NAMES[1:4]
    said = rest_doubts(align(rest, JointMap("right", tuple(swapped)), hand))
    assert "mm from the hand's on average" in said
    large, *_ = ours_elsewhere("right", 2, scale=3.0)
    assert rest_doubts(align(large, joint_map("right"), hand)) == "it is 3 times as large as a hand"


@pytest.mark.slow
def test_without_tips_a_tail_shows_the_way_and_a_nonsense_tail_does_not(hand):
    rest, *_ = ours_elsewhere("right", 0, tips=(None,) * 5)
    with_tips, *_ = ours_elsewhere("right", 0)
    truth = align(with_tips, joint_map("right"), hand, MEAN)
    tails = rest.tails.copy()
    tails[3:16:3] = rest.heads[3:16:3] + 0.3 * (with_tips.heads[16:] - rest.heads[3:16:3])
    reported = type(rest)(rest.names, rest.parents, rest.heads, tails, rest.frames)
    map_without = joint_map("right", (None,) * 5)
    aligned = align(reported, map_without, hand, MEAN)
    np.testing.assert_allclose(aligned.rotations, truth.rotations, atol=1e-9)
    straight = align(rest, map_without, hand, MEAN)
    assert np.isfinite(straight.rotations).all()
    np.testing.assert_allclose(straight.rotations[[1, 2, 14]], truth.rotations[[1, 2, 14]], atol=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_known_shape_and_size_are_found(hand, seed):
    rng = np.random.default_rng(seed)
    beta, scale = rng.normal(size=10), rng.uniform(0.5, 2)
    model = hand
    theirs = scale * forward(rest_nodes(model, beta), rng.normal(size=(16, 3)) * 0.3)[1]
    found = fit_shape(model, theirs)
    ours = found.scale * rest_nodes(model, found.beta)
    bones = [(4 * f + k, 4 * f + k + 1) for f in range(5) for k in (1, 2, 3)] + [
        (0, 1),
        (0, 5),
        (0, 9),
        (0, 13),
        (1, 9),
    ]
    lengths = [[np.linalg.norm(nodes[a] - nodes[b]) for a, b in bones] for nodes in (ours, theirs)]
    np.testing.assert_allclose(lengths[0], lengths[1], atol=0.001 * scale)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_a_hand_that_is_unlike_ours_gets_a_natural_shape(hand, seed):
    """Fingers up to a tenth longer or shorter than ours, each by its own: no beta is at its bound."""
    rng = np.random.default_rng(seed)
    rest, *_ = ours_elsewhere("right", seed)
    heads, stretched = rest.heads.copy(), rest.heads.copy()
    for finger in range(5):
        rows = [3 * finger + 1, 3 * finger + 2, 3 * finger + 3, 16 + finger]
        knuckle = heads[0] + rng.uniform(0.95, 1.05) * (heads[rows[0]] - heads[0])
        stretched[rows] = knuckle + rng.uniform(0.9, 1.1) * (heads[rows] - heads[rows[0]])
    alignment = align(replace(rest, heads=stretched), joint_map("right"), hand)
    error_mm = 1e3 * np.linalg.norm(alignment.joints - alignment.heads, axis=1) / alignment.shape.scale
    assert np.abs(alignment.shape.beta).max() < 3.9
    assert error_mm.mean() < 4
    assert rest_doubts(alignment) is None


def test_a_left_hand_drives_a_right_one_as_in_a_mirror(hand):
    thetas = np.array([gesture("fist", "left"), gesture("point", "left")])
    rest, posed, *_ = ours_elsewhere("left", 2)
    left = retarget(posed(thetas), align(rest, joint_map("left"), hand))
    np.testing.assert_allclose(mirrored(left).theta[:, 1:], thetas[:, 1:] * MIRROR_AXIS_ANGLE, atol=1e-6)


def test_joints_in_one_place_and_poses_that_are_not_finite_are_refused(hand):
    rest, posed, *_ = ours_elsewhere("right")
    rest.heads[2] = rest.heads[1]
    with pytest.raises(LiveHandError, match="joints must lie apart, got 'index1' or the next"):
        align(rest, joint_map("right"), hand)
    good = posed(np.zeros((1, 16, 3)))
    with pytest.raises(LiveHandError, match="finite"):
        SourceMotion(good.frames * np.nan, good.wrists, None, "right")
    with pytest.raises(LiveHandError, match="frames must be"):
        SourceMotion(good.frames[:, :15], good.wrists, None, "right")


@pytest.mark.slow
def test_a_size_in_another_unit_is_guessed(hand):
    rest, *_ = ours_elsewhere("right", 1)
    for factor, words in ((0.01, "scaled by 100 it would be one"), (39.37, "scaled by 0.0254 it would be one")):
        scaled = replace(rest, heads=rest.heads * factor, tails=rest.tails * factor)
        alignment = align(scaled, joint_map("right"), hand)
        assert words in rest_doubts(alignment)
        assert rest_doubts(alignment, 1 / alignment.shape.scale) is None
