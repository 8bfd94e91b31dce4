"""Import Motion reads BVH, FBX and glTF: known poses, and nothing of the file is left behind."""

import json

import bpy
import numpy as np
import pytest
from livehand.backend.commands import render_motion
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import JOINT_NAMES, MIRROR_AXIS_ANGLE, PARENTS
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rigs.shape_fit import rest_nodes
from livehand.livehand_blender.cli import main
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.keyframes import keyframe_theta
from livehand.livehand_blender.rig.pose import read_hand_pose
from livehand.livehand_blender.rigs.importing import UNITS_M, all_data, import_rig, likely_unit
from livehand.livehand_blender.rigs.rig_motion import read_upright
from mathutils import Matrix

# Blender's BVH importer does not close its file.
pytestmark = [
    pytest.mark.filterwarnings("ignore::ResourceWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
]
Y_UP = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])


def bvh_name(joint, side):
    title = side.title() + "Hand"
    return title if joint == 0 else f"{title}{JOINT_NAMES[joint].title()}"


def anatomical_name(joint, side):
    """As trackers of bare hands name joints."""
    finger, number = JOINT_NAMES[joint][:-1].upper(), JOINT_NAMES[joint][-1]
    parts = ("CMC", "MCP", "IP") if finger == "THUMB" else ("MCP", "PIP", "DIP")
    return "WRIST" if joint == 0 else f"{finger}_{parts[int(number) - 1]}"


def write_bvh(path, side, thetas, wrists_cm, fps, name_of=bvh_name, rest_theta=None, per_m=100.0, mirror=(1, 1, 1)):
    """Our hand in BVH: Y up, the wrist's rotation and place in the file's world, at rest as in `rest_theta`.

    All is mirrored by factors of the axes.
    """
    flip = np.diag(np.array(mirror, float))
    nodes = per_m * rest_nodes(load_default_hand().for_side(side), np.zeros(10)) @ flip
    rest = flip @ global_turns(np.zeros((16, 3)) if rest_theta is None else rest_theta) @ flip
    joints = nodes[[0, *(4 * f + k for f in range(5) for k in (1, 2, 3))]]
    lines = ["HIERARCHY"]

    def write(joint, depth):
        pad = "  " * depth
        above = PARENTS[joint]
        offset = np.zeros(3) if joint == 0 else rest[above] @ (joints[joint] - joints[above])
        channels = "Zrotation Xrotation Yrotation"
        lines.append(f"{pad}{'JOINT' if joint else 'ROOT'} {name_of(joint, side)}")
        lines.append(f"{pad}{{\n{pad}  OFFSET {offset[0]:.7f} {offset[1]:.7f} {offset[2]:.7f}")
        lines.append(f"{pad}  CHANNELS {'3' if joint else '6 Xposition Yposition Zposition'} {channels}")
        below = [child for child in range(16) if PARENTS[child] == joint]
        for child in below:
            write(child, depth + 1)
        if not below:
            x, y, z = rest[joint] @ (nodes[4 * ((joint - 1) // 3) + 4] - joints[joint])
            lines.append(f"{pad}  End Site\n{pad}  {{\n{pad}    OFFSET {x:.7f} {y:.7f} {z:.7f}\n{pad}  }}")
        lines.append(f"{pad}}}")

    write(0, 0)
    lines += ["MOTION", f"Frames: {len(thetas)}", f"Frame Time: {1 / fps:.8f}"]
    for theta, wrist in zip(thetas, wrists_cm, strict=True):
        numbers = [*(flip @ wrist)]
        since_rest = flip @ global_turns(theta) @ flip @ rest.swapaxes(1, 2)
        for joint in range(16):
            above = since_rest[PARENTS[joint]] if joint else np.eye(3)
            angles = np.rad2deg(Matrix((above.T @ since_rest[joint]).tolist()).to_euler("YXZ"))  # R = Rz Rx Ry
            numbers += [angles[2], angles[0], angles[1]]
        lines.append(" ".join(f"{number:.6f}" for number in numbers))
    path.write_text("\n".join(lines) + "\n")
    return path


def global_turns(theta):
    turns = list(axis_angle_to_matrix(theta))
    for joint in range(1, 16):
        turns[joint] = turns[PARENTS[joint]] @ turns[joint]
    return np.array(turns)


def some_thetas(side):
    axes = FingerAxes.of_default_hand()
    thetas = [
        theta_of(GESTURES[name].angles_deg(), axes, np.array(root))
        for name, root in (
            ("rest", [0, 0, 0]),
            ("fist", [0.2, 0.3, -0.4]),
            ("point", [0, -0.6, 0]),
            ("pinch", [0.5, 0, 0]),
        )
    ]
    return np.array(thetas) * (1 if side == "right" else MIRROR_AXIS_ANGLE)


def pose_at(hand, frame):
    bpy.context.scene.frame_set(frame)
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())


def run(path, **options):
    return bpy.ops.livehand.import_motion(filepath=str(path), start_frame=1, **options)


@pytest.mark.parametrize("fps", [24, 30, 120])
def test_a_bvh_with_known_answers(hand, model, tmp_path, fps):
    thetas = some_thetas(model.side)
    wrists_cm = np.array([[0, 100, 0], [10, 100, 0], [10, 110, 5], [0, 100, 0.0]])
    before = all_data()
    run(write_bvh(tmp_path / "m.bvh", model.side, thetas, wrists_cm, fps), match_fps=False)
    assert {type(thing).__name__ for thing in all_data() - before} == {"Action"}  # the hand's own
    nodes = rest_nodes(model, np.zeros(10))
    for frame, (theta, wrist) in enumerate(zip(thetas, wrists_cm, strict=True), 1):
        pose = pose_at(hand, frame)
        np.testing.assert_allclose(pose.theta[1:], theta[1:], atol=2e-4)
        root = matrix_to_axis_angle(Y_UP @ axis_angle_to_matrix(theta[0]))
        np.testing.assert_allclose(pose.theta[0], root, atol=2e-4)
        np.testing.assert_allclose(pose.transl + nodes[0], Y_UP @ wrist / 100, atol=1e-4)
    assert tuple(hand["beta"]) == (0.0,) * 10


def test_the_frame_rate_is_converted(hand, model, tmp_path):
    thetas = np.repeat(some_thetas(model.side)[:2], 30, 0)
    path = write_bvh(tmp_path / "m.bvh", model.side, thetas, np.zeros((60, 3)), 60)
    bpy.context.scene.render.fps = 30
    run(path)
    assert tuple(hand.animation_data.action.frame_range) == (1, 30)
    np.testing.assert_allclose(pose_at(hand, 29).theta[1:], thetas[-1, 1:], atol=2e-4)
    assert bpy.context.scene.render.fps == 30
    run(path, fps=30)
    assert tuple(hand.animation_data.action.frame_range) == (1, 60)


@pytest.mark.parametrize("size", [0.75, 1.0, 1.35])
@pytest.mark.parametrize("unit", UNITS_M)
def test_the_unit_is_the_one_that_gives_a_hands_size(size, unit):
    assert UNITS_M[likely_unit(size / UNITS_M[unit])] == UNITS_M[unit]


def test_a_bare_hand_with_anatomical_names_and_a_rest_pose_that_is_no_hands(hand, model, tmp_path):
    """The fingers point anywhere at rest, and the unit is the decimetre."""
    rest_theta = np.random.default_rng(0).normal(size=(16, 3))
    rest_theta[0] = 0
    thetas = some_thetas(model.side)
    wrists = np.zeros((4, 3))
    path = write_bvh(tmp_path / "m.bvh", model.side, thetas, wrists, 24, anatomical_name, rest_theta, 10.0)
    assert run(path, side=model.side, match_fps=False) == {"FINISHED"}
    off = [np.linalg.norm(pose_at(hand, frame).theta[1:] - thetas[frame - 1, 1:], axis=1) for frame in range(1, 5)]
    assert np.rad2deg(np.max(off, 0)[:12].max()) < 10
    assert np.rad2deg(np.max(off, 0)[12:].max()) < 25
    nodes = rest_nodes(model, np.zeros(10))
    np.testing.assert_allclose(pose_at(hand, 2).transl + nodes[0], 0, atol=1e-3)


def test_a_motion_beyond_what_a_hand_can_is_warned_of(hand, model, tmp_path, capfd):
    angles = np.zeros((15, 3))
    angles[4, 0] = 170
    theta = theta_of(angles, FingerAxes.of_default_hand()) * (1 if model.side == "right" else MIRROR_AXIS_ANGLE)
    thetas = np.tile(theta, (4, 1, 1))
    run(write_bvh(tmp_path / "m.bvh", model.side, thetas, np.zeros((4, 3)), 24))
    said = capfd.readouterr()
    assert "Check the motion: middle2 bend" in said.out + said.err


@pytest.mark.parametrize("mirror", [(-1, 1, 1), (1, 1, -1)], ids=["x", "z"])
def test_left_handed_axes_are_mirrored_back_with_a_word(hand, model, tmp_path, capfd, mirror):
    thetas = np.repeat(some_thetas(model.side), 3, 0)
    path = write_bvh(tmp_path / "m.bvh", model.side, thetas, np.zeros((12, 3)), 3, mirror=mirror)
    run(path, match_fps=False)
    said = capfd.readouterr()
    assert "Check the motion: its hand is a mirror image" in said.out + said.err
    for frame in (1, 4, 7, 10):
        np.testing.assert_allclose(pose_at(hand, frame).theta[1:], thetas[frame - 1, 1:], atol=2e-4)


def test_a_file_without_fingers_has_no_hand(hand, tmp_path):
    bones = "ROOT Hips\n{\n OFFSET 0 0 0\n CHANNELS 3 Zrotation Xrotation Yrotation\n JOINT RightHand\n {\n"
    bones += "  OFFSET 0 1 0\n  CHANNELS 3 Zrotation Xrotation Yrotation\n"
    bones += "  End Site\n  {\n   OFFSET 0 1 0\n  }\n }\n}\n"
    (tmp_path / "m.bvh").write_text(f"HIERARCHY\n{bones}MOTION\nFrames: 1\nFrame Time: 0.1\n0 0 0 0 0 0\n")
    with pytest.raises(RuntimeError, match="there is none in this file"):
        run(tmp_path / "m.bvh")


@pytest.mark.parametrize("suffix", ["glb", "fbx"])
def test_files_of_another_rig_animate_our_hand_and_leave_nothing_behind(other_rigs, model, tmp_path, suffix):
    made = other_rigs.make_rigged_hand(model.side)
    frames = made.animate()
    path = {"glb": other_rigs.write_glb, "fbx": other_rigs.write_fbx}[suffix](made, tmp_path / f"h.{suffix}")
    ours = add_hand(bpy.context, model)
    ours.location = (0.3, 0.2, 0.1)
    bpy.context.view_layer.objects.active = ours
    bpy.ops.object.mode_set(mode="POSE")
    before = all_data()
    assert run(path, set_shape=True) == {"FINISHED"}
    assert {type(thing).__name__ for thing in all_data() - before} == {"Action"}
    assert (bpy.context.mode, bpy.context.active_object) == ("POSE", ours)
    rest = rest_nodes(model, np.zeros(10))
    rows = [int(np.linalg.norm(model.v_template - rest[4 * f + 4], axis=1).argmin()) for f in range(5)]
    errors = []
    for frame in frames:
        bpy.context.scene.frame_set(frame)
        mesh = ours.livehand.mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
        tips = np.array([mesh.matrix_world @ mesh.data.vertices[row].co for row in rows])
        errors.append(np.linalg.norm(tips - made.fingertips(), axis=1))
    assert np.max(errors) < 0.005


def test_the_other_hand_of_a_file_is_rejected_or_mirrored(hand, model, tmp_path):
    other = "left" if model.side == "right" else "right"
    thetas = some_thetas(other)
    path = write_bvh(tmp_path / "m.bvh", other, thetas, np.zeros((4, 3)), 24)
    before = all_data(), tuple(hand.scale)
    with pytest.raises(RuntimeError, match="turn on Mirror"):
        run(path, set_shape=True)
    with pytest.raises(RuntimeError, match=f"must hold a {model.side} hand"):
        run(path, side=model.side)
    assert (all_data(), tuple(hand.scale)) == before
    run(path, mirror=True)
    np.testing.assert_allclose(pose_at(hand, 2).theta[1:], thetas[1, 1:] * MIRROR_AXIS_ANGLE, atol=2e-4)


def test_unreadable_files_change_nothing(other_rigs, hand, model, tmp_path):
    keyframe_theta(RiggedHand.of(hand), np.zeros((1, 16, 3)), [1])
    (tmp_path / "no.bvh").write_text("nothing at all")
    for suffix in ("fbx", "glb", "gltf"):
        (tmp_path / f"no.{suffix}").write_bytes(b"nothing at all" * 10)
    cube = bpy.data.objects.new("Cube", bpy.data.meshes.new("Cube"))
    bpy.context.scene.collection.objects.link(cube)
    hand.select_set(False)
    cube.select_set(True)
    bpy.ops.export_scene.gltf(filepath=str(tmp_path / "cube.glb"), use_selection=True)
    bpy.context.view_layer.objects.active = hand
    before = all_data()
    for name, message in {
        "no.bvh": "must be a BVH file",
        "no.fbx": "importer failed",
        "no.glb": "importer failed",
        "no.gltf": "importer failed",
        "cube.glb": "must hold an armature",
        "gone.fbx": "no file at",
    }.items():
        with pytest.raises(RuntimeError, match=message):
            run(tmp_path / name)
        assert all_data() == before, name
    assert tuple(hand.animation_data.action.frame_range) == (1, 1)
    assert bpy.context.scene.name == "Scene"


def test_an_importer_that_is_not_enabled_is_named(model, tmp_path):
    path = write_bvh(tmp_path / "m.bvh", model.side, some_thetas(model.side), np.zeros((4, 3)), 24)
    with pytest.raises(LiveHandError, match=r"BioVision Motion Capture \(BVH\) format'"):
        import_rig(path, importer_of=lambda suffix: None)


def test_the_import_prints_nothing(hand, model, tmp_path, capfd):
    path = write_bvh(tmp_path / "m.bvh", model.side, some_thetas(model.side), np.zeros((4, 3)), 24)
    run(path)
    assert [line for line in capfd.readouterr().out.splitlines() if not line.startswith("Info:")] == []


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_program_inspects_and_renders_a_rigs_file(tmp_path, side, capsys, monkeypatch):
    thetas = some_thetas(side)
    path = write_bvh(tmp_path / "m.bvh", side, thetas, np.ones((4, 3)), 24)
    assert main(["inspect", str(path), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (facts["kind"], facts["hand"], facts["frames"], facts["fps"]) == ("animated rig", side, 4, 24)
    assert facts["bones"].startswith(f"{side.title()}Hand, {side.title()}HandIndex1")
    assert facts["scale_of_hand"] == pytest.approx(1, rel=0.01)
    assert "check" not in facts
    motion = read_upright(path, load_default_hand())
    np.testing.assert_allclose(motion.theta[:, 1:], thetas[:, 1:], atol=2e-4)
    model = load_default_hand().for_side(side)
    np.testing.assert_allclose(motion.transl + rest_nodes(model, np.zeros(10))[0], 0, atol=1e-4)
    frames = []
    monkeypatch.setattr(render_motion, "run", lambda args, read: frames.append(read(path, model)) or {"summary": ""})
    assert main(["render", str(path), "-o", str(tmp_path / "out"), "--avatar", "deep"]) == 0
    np.testing.assert_array_equal(frames[0].theta, motion.theta)


def test_a_vrm_is_a_gltf(other_rigs, tmp_path):
    made = other_rigs.make_rigged_hand()
    path = other_rigs.write_glb(made, tmp_path / "h.glb").rename(tmp_path / "h.vrm")
    bpy.ops.wm.read_homefile(use_empty=True)
    import_rig(path)
    assert [thing.name for thing in bpy.context.scene.objects if thing.type == "ARMATURE"]
