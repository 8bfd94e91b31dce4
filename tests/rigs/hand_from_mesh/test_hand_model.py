"""Somebody's skinned mesh as a hand model: what comes out is the hand that went in, wherever it stood."""

import json
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.geometry.mesh_tables import connected_components, open_half_edges
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.atlas import unwrap
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.measurements import fit_beta
from livehand.backend.hand.model import JOINT_NAMES, PARENTS
from livehand.backend.hand.model_file import load_hand_model
from livehand.backend.motion.landmarks.skeleton import HandSkeleton
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.rigs.hand_from_mesh.hand_model import (
    joint_regressor,
    joint_weights,
    joints_of_bones,
    make_hand_model,
    save_hand_model,
    world2template,
)
from livehand.backend.rigs.hand_from_mesh.skinned_surface import SkinnedSurface
from livehand.backend.rigs.source_skeleton import JointMap, SourceSkeleton
from livehand.tools.builtin_hand import TEMPLATE

TURN = axis_angle_to_matrix(np.array([0.7, -1.9, 0.4]))
PLACE = np.array([0.3, -2.0, 1.1])
FRAME_M = 1e-9  # the template's frame is that of the hand with an arm, whose joints are this one's to 0.07 nm


@pytest.fixture(scope="module")
def atlas_of():
    """The built-in hand's atlas for its own faces: unwrapping is tested elsewhere, and takes a second."""
    hand = load_hand_model(TEMPLATE)
    return lambda vertices, faces: (hand.vt, hand.ft) if len(faces) == len(hand.f) else unwrap(vertices, faces)


@pytest.fixture(autouse=True)
def _quick_atlas(monkeypatch, atlas_of):
    monkeypatch.setattr("livehand.backend.rigs.hand_from_mesh.hand_model.unwrap", atlas_of)


def rig(side="right", scale=1.0):
    """The built-in hand, standing somewhere, in units of 1/scale m: surface, skeleton and map."""
    hand = load_hand_model(TEMPLATE).for_side(side)
    vertices, joints = ((points @ TURN.T + PLACE) / scale for points in (hand.v_template, hand.joints))
    frames = np.tile(np.eye(3), (16, 1, 1))
    skeleton = SourceSkeleton(JOINT_NAMES, PARENTS, joints, joints + 0.01 / scale, frames)
    surface = SkinnedSurface(vertices, hand.f, np.arange(len(hand.f)), hand.lbs_weights)
    return surface, skeleton, JointMap(side, JOINT_NAMES)


@pytest.mark.slow
@pytest.mark.parametrize("side", ["right", "left"])
def test_the_built_in_hand_round_trip(side, tmp_path):
    hand = load_hand_model(TEMPLATE).for_side(side)
    path = tmp_path / ("mine.npz" if side == "right" else "mine_left.npz")
    made = make_hand_model(*rig(side))
    save_hand_model(made, path, {"made_by": "a test"})
    model = load_hand_model(path)
    assert model.side == side
    np.testing.assert_allclose(model.v_template, hand.v_template, atol=FRAME_M)
    np.testing.assert_allclose(model.joints, hand.joints, atol=FRAME_M)
    np.testing.assert_allclose(model.lbs_weights, hand.lbs_weights, atol=1e-12)
    np.testing.assert_array_equal(model.f, hand.f)
    assert tuple(model.parents) == PARENTS
    assert not model.shapedirs.any()
    assert not model.posedirs.any()
    rng = np.random.default_rng(3)
    pose = HandPose(rng.normal(size=(16, 3)), np.zeros(10), rng.normal(size=3), side)
    bare = replace(hand, posedirs=np.zeros_like(hand.posedirs))
    np.testing.assert_allclose(posed_vertices(model, pose), posed_vertices(bare, pose), atol=FRAME_M)
    with np.load(path) as arrays:
        assert json.loads(str(arrays["provenance"])) == {"made_by": "a test"}


@pytest.mark.slow
def test_the_world_is_carried_to_the_template():
    surface, *_ = rig(scale=0.01)
    made = make_hand_model(*rig(scale=0.01), scale=0.01)
    carried = surface.vertices_m @ made.world2template[:3, :3].T + made.world2template[:3, 3]
    np.testing.assert_allclose(carried, made.arrays["v_template"], atol=1e-12)
    np.testing.assert_allclose(made.arrays["v_template"], load_hand_model(TEMPLATE).v_template, atol=FRAME_M)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scale", "said"), [(0.01, "centimetres: scale it by 0.01"), (0.001, "millimetres"), (0.0254, "inches"), (7, "it")]
)
def test_a_hand_in_other_units_is_refused_with_the_unit(scale, said):
    with pytest.raises(LiveHandError, match=rf"0\.1 to 0\.3 m.*{said}"):
        make_hand_model(*rig(scale=scale))


@pytest.mark.parametrize("side", ["right", "left"])
def test_a_hand_said_to_be_the_other_one_is_refused(side):
    surface, skeleton, joint_map = rig(side)
    other = "left" if side == "right" else "right"
    with pytest.raises(LiveHandError, match=f"choose the {side} side"):
        make_hand_model(surface, skeleton, replace(joint_map, side=other))


def test_a_flat_hand_may_be_either(hand):
    joints = hand.joints * [1, 0, 1]
    for side in ("right", "left"):
        world2template(joints, side)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "side", "remedy"),
    [("mine.npz", "left", "mine_left.npz"), ("left.npz", "right", "right.npz"), ("mine.blend", "right", "end with")],
)
def test_a_file_name_of_the_other_side_is_refused(name, side, remedy, tmp_path):
    made = replace(make_hand_model(*rig()), side=side)
    with pytest.raises(LiveHandError, match=remedy):
        save_hand_model(made, tmp_path / name, {})
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_inward_faces_and_too_many_vertices_are_refused(monkeypatch):
    surface, skeleton, joint_map = rig()
    with pytest.raises(LiveHandError, match="must point outward"):
        make_hand_model(replace(surface, faces=surface.faces[:, ::-1]), skeleton, joint_map)
    monkeypatch.setattr("livehand.backend.rigs.hand_from_mesh.hand_model.MOST_VERTICES", 1271)
    with pytest.raises(LiveHandError, match="100 to 1271 vertices, got 1272; decimate"):
        make_hand_model(surface, skeleton, joint_map)


@pytest.mark.slow
def test_a_model_without_shapes_cannot_be_measured_for_one(tmp_path):
    save_hand_model(make_hand_model(*rig()), tmp_path / "mine.npz", {})
    with pytest.raises(LiveHandError, match="'mine' has none"):
        fit_beta(load_hand_model(tmp_path / "mine.npz"), 0.19, 0.08)


# A forearm above the wrist, a metacarpal and a tip, a second bone in the wrist's place with a finger below it (as in
# control rigs), and another limb.
BONES = ("body", "leg", "forearm", "wrist", "palm", "index1", "index2", "index3", "tip", "control", "twist")
ABOVE = (-1, 0, 0, 2, 3, 4, 5, 6, 7, 2, 9)


def test_bones_that_are_no_joints_go_to_the_one_above():
    fingers = [name for name in JOINT_NAMES[1:] if not name.startswith("index")]
    names, parents = (*BONES, *fingers), [*ABOVE]
    for name in fingers:
        parents.append(9 if name[-1] == "1" else len(parents) - 1)
    heads = np.arange(3 * len(names)).reshape(-1, 3) / 10.0
    heads[9] = heads[3] + 1e-4
    skeleton = SourceSkeleton(names, tuple(parents), heads, heads, np.tile(np.eye(3), (len(names), 1, 1)))
    joint_of = joints_of_bones(skeleton, JointMap("right", JOINT_NAMES))
    assert joint_of[:11].tolist() == [-1, -1, -1, 0, 0, 1, 2, 3, 3, 0, 0]
    assert joint_of[11:].tolist() == [JOINT_NAMES.index(name) for name in fingers]
    weights = np.zeros((3, len(names)))
    weights[0, [2, 3, 4]] = 0.5, 0.25, 0.25  # half the forearm's
    weights[1, [7, 8]] = 3.0, 1.0  # Blender scales rows
    folded, share = joint_weights(weights, joint_of)
    np.testing.assert_allclose(share, [0.5, 1, 0])
    np.testing.assert_allclose(folded, np.eye(16)[[0, 3, 0]])


def test_regressor_rows_are_exact_and_local(hand):
    rows = joint_regressor(hand.v_template, hand.joints)
    np.testing.assert_allclose(rows @ hand.v_template, hand.joints, atol=1e-15)
    np.testing.assert_allclose(rows.sum(1), 1, atol=1e-12)
    for joint, row in zip(hand.joints[1:], rows[1:], strict=True):
        assert np.linalg.norm(hand.v_template[row != 0] - joint, axis=1).max() < 0.03
    with pytest.raises(LiveHandError, match="in one plane"):
        joint_regressor(hand.v_template * [1, 0, 1], hand.joints + np.array([0, 0.01, 0]))


def loose_pieces(surface, skeleton, joint_map, gap=0.8):
    """The same hand in one shell for each joint, smaller than its part of the skin, so that no two shells touch."""
    joint = surface.weights.argmax(1)
    vertices, faces, weights = [], [], []
    for k in range(16):
        own = surface.faces[(joint[surface.faces] == k).all(1)]
        used, compact = np.unique(own, return_inverse=True)
        points = surface.vertices_m[used]
        faces.append(compact.reshape(-1, 3) + sum(map(len, vertices)))
        vertices.append(points.mean(0) + gap * (points - points.mean(0)))
        weights.append(surface.weights[used])
    faces = np.concatenate(faces)
    made = SkinnedSurface(np.concatenate(vertices), faces, np.arange(len(faces)), np.concatenate(weights))
    return made, skeleton, joint_map


@pytest.mark.slow
def test_a_hand_in_loose_pieces_is_whole(tmp_path):
    surface, skeleton, joint_map = loose_pieces(*rig())
    made = make_hand_model(surface, skeleton, joint_map)
    assert made.cut.other_pieces == 0
    assert len(made.cut.source) == len(surface.vertices_m)
    assert (made.arrays["weights"].max(0) > 0.9).all()
    save_hand_model(made, tmp_path / "mine.npz", {})
    model = load_hand_model(tmp_path / "mine.npz")
    assert connected_components(model.f, len(model.v_template)).max() > 0
    assert len(open_half_edges(model.f)) == 0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("gone", "said"), [(["index3"], "none for index3; if"), (["wrist", "pinky1"], "none for wrist, pinky1; if")]
)
def test_a_joint_that_moves_nothing_is_refused_by_name(gone, said):
    surface, skeleton, joint_map = loose_pieces(*rig())
    joints = [JOINT_NAMES.index(name) for name in gone]
    faces = surface.faces[~np.isin(surface.weights.argmax(1), joints)[surface.faces].any(1)]
    weights = surface.weights.copy()
    weights[:, joints] = 0
    with pytest.raises(LiveHandError, match=said):
        make_hand_model(
            replace(surface, faces=faces, polygons=np.arange(len(faces)), weights=weights), skeleton, joint_map
        )


def test_a_mesh_shorter_than_its_bones_is_refused():
    surface, skeleton, joint_map = rig()
    shrunk = skeleton.heads[0] + 0.5 * (surface.vertices_m - skeleton.heads[0])
    with pytest.raises(LiveHandError, match=r"ends .* mm from the wrist"):
        make_hand_model(replace(surface, vertices_m=shrunk), skeleton, joint_map)


@pytest.mark.slow
def test_one_piece_turned_inside_out_is_refused():
    surface, skeleton, joint_map = loose_pieces(*rig())
    faces = surface.faces.copy()
    piece = connected_components(faces, len(surface.vertices_m))[faces[:, 0]]
    faces[piece == piece[-1]] = faces[piece == piece[-1]][:, ::-1]
    with pytest.raises(LiveHandError, match="inward in 1 of 16 pieces"):
        make_hand_model(replace(surface, faces=faces), skeleton, joint_map)


@pytest.mark.slow
@pytest.mark.parametrize("gone", [("pinky3",), ("ring1", "ring2", "ring3"), ("index3", "thumb3")], ids=str)
def test_a_rig_that_lacks_joints_makes_a_hand(hand, gone, tmp_path):
    """The bone above moves their part of the mesh; the joints continue the finger and move nothing."""
    surface, skeleton, _ = rig()
    bones = tuple(None if name in gone else name for name in JOINT_NAMES)
    weights = surface.weights.copy()
    for name in gone:
        joint = JOINT_NAMES.index(name)
        weights[:, PARENTS[joint]] += weights[:, joint] if joint % 3 != 1 else 0
        weights[:, joint] = 0
    kept = (weights.sum(1) > 0)[surface.faces].all(1)
    surface = replace(surface, weights=weights, faces=surface.faces[kept], polygons=np.arange(kept.sum()))
    made = make_hand_model(surface, skeleton, JointMap("right", bones))
    save_hand_model(made, tmp_path / "mine.npz", {})
    model = load_hand_model(tmp_path / "mine.npz")
    lacking = [JOINT_NAMES.index(name) for name in gone]
    assert not model.lbs_weights[:, lacking].any()
    np.testing.assert_allclose(model.joints, hand.joints, atol=0.004)
    nodes = HandSkeleton.of(model).rest
    assert np.linalg.norm(np.diff(nodes[1:].reshape(5, 4, 3), axis=1), axis=-1).min() > 0.01


@pytest.mark.slow
def test_bones_in_a_pose_that_no_hand_can_have_are_refused():
    surface, skeleton, joint_map = rig()
    bones = list(JOINT_NAMES)
    bones[13], bones[14] = "thumb2", "thumb1"
    with pytest.raises(LiveHandError, match=r"thumb1.* beyond what a hand can; correct which bone"):
        make_hand_model(surface, skeleton, replace(joint_map, bones=tuple(bones)))
