"""Motions onto hands and back: values at frames, spaces, sides, rates; and that a failure changes nothing."""

import time
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.files.open_files import open_motion_file, open_pose_file
from livehand.backend.motion.formats.own import write_motion
from livehand.backend.motion.landmarks.skeleton import NODES_OF_LANDMARKS, HandSkeleton
from livehand.backend.motion.landmarks.take_file import FilmedTake, write_take
from livehand.backend.motion.landmarks.take_fit import FilmCamera, FilmedHand
from livehand.backend.motion.motion import HandMotion, mirrored
from livehand.backend.motion.spaces import TO_BLENDER
from livehand.backend.rigs.rig_suffixes import RIG_SUFFIXES
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.keyframes import keyframe_transl
from livehand.livehand_blender.rig.pose import read_hand_pose, write_hand_pose
from livehand.livehand_blender.ui.motion import LIVEHAND_OT_import_motion
from mathutils import Matrix, Vector


def motion_of(side="right", count=6, seed=0, **changes):
    rng = np.random.default_rng(seed)
    theta = rng.normal(size=(count, 16, 3)) * 0.5
    fields = {"theta": theta, "beta": np.zeros(10), "transl": rng.normal(size=(count, 3)) * 0.1, "fps": 24.0}
    return HandMotion(**{**fields, **changes}, side=side)


def write_raw(path, motion, **more):
    poses = np.concatenate([motion.theta.reshape(-1, 48), motion.transl], 1)
    np.savez(path, poses=poses, side=motion.side, **more)
    return str(path)


def read(hand, frame):
    bpy.context.scene.frame_set(frame)
    return read_hand_pose(hand, bpy.context.evaluated_depsgraph_get())


def is_untouched(hand):
    return hand.animation_data is None or hand.animation_data.action is None


def test_an_imported_motion_is_exported_unchanged(hand, model, tmp_path):
    motion = motion_of(model.side)
    write_motion(motion, tmp_path / "in.npz")
    assert bpy.ops.livehand.import_motion(filepath=str(tmp_path / "in.npz"), start_frame=11) == {"FINISHED"}
    for index in (0, 3, 5):
        pose = read(hand, 11 + index)
        np.testing.assert_allclose(pose.theta, motion.theta[index], atol=1e-5)
        np.testing.assert_allclose(pose.transl, motion.transl[index], atol=1e-6)
    bpy.context.scene.frame_set(3)
    out = str(tmp_path / "out.npz")
    bpy.ops.livehand.export_motion(filepath=out, use_scene_range=False, first=11, last=16)
    assert bpy.context.scene.frame_current == 3
    again = open_pose_file(tmp_path / "out.npz").motion()
    np.testing.assert_allclose(again.theta, motion.theta, atol=1e-5)
    np.testing.assert_allclose(again.transl, motion.transl, atol=1e-6)
    assert (again.side, again.fps) == (model.side, 24.0)


@pytest.mark.parametrize("key_place", [True, False])
def test_a_motion_with_a_forearm_comes_through_an_armed_hand(armed_hand, armed_model, tmp_path, key_place):
    motion = motion_of(armed_model.side, forearm=np.random.default_rng(9).normal(size=(6, 3)) * 0.5)
    write_motion(motion, tmp_path / "in.npz")
    path = str(tmp_path / "in.npz")
    bpy.ops.livehand.import_motion(filepath=path, start_frame=1, set_shape=False, key_place=key_place)
    bpy.ops.livehand.export_motion(filepath=str(tmp_path / "out.npz"), use_scene_range=False, first=1, last=6)
    again = open_pose_file(tmp_path / "out.npz").motion()
    for name in ("theta", "forearm"):
        np.testing.assert_allclose(getattr(again, name), getattr(motion, name), atol=1e-5)
    np.testing.assert_allclose(again.transl, motion.transl if key_place else 0 * motion.transl, atol=1e-6)


def test_the_scene_range_is_exported_and_a_reversed_range_rejected(hand, tmp_path):
    bpy.context.scene.frame_start, bpy.context.scene.frame_end = 3, 7
    bpy.ops.livehand.export_motion(filepath=str(tmp_path / "out.npz"))
    assert len(open_pose_file(tmp_path / "out.npz").motion()) == 5
    with pytest.raises(RuntimeError, match="must not lie before the first, got 5 to 4"):
        bpy.ops.livehand.export_motion(filepath=str(tmp_path / "x.npz"), use_scene_range=False, first=5, last=4)
    assert not (tmp_path / "x.npz").exists()


@pytest.mark.parametrize("space", ["z_up", "y_up", "opencv", "opengl"])
def test_a_world_motion_is_converted_to_blenders_world(hand, model, evaluated_vertices, tmp_path, space):
    hand.matrix_world = Matrix.Translation((0.3, -2, 1)) @ Matrix.Rotation(1.1, 4, (1, 2, 3))
    motion = motion_of(model.side, seed=1)
    bpy.ops.livehand.import_motion(filepath=write_raw(tmp_path / "t.npz", motion), space=space, start_frame=1)
    bpy.context.scene.frame_set(4)
    world = np.array(hand.matrix_world)
    seen = evaluated_vertices(hand) @ world[:3, :3].T + world[:3, 3]
    expected = posed_vertices(load_default_hand(), motion.pose(3)) @ TO_BLENDER[space].T
    np.testing.assert_allclose(seen, expected, atol=1e-5)


@pytest.mark.parametrize("space", ["opencv", "opengl"])
def test_a_motion_in_camera_axes_can_use_the_scene_camera(hand, model, tmp_path, space):
    path = write_raw(tmp_path / "t.npz", motion_of(model.side))
    with pytest.raises(RuntimeError, match="got none; add one"):
        bpy.ops.livehand.import_motion(filepath=path, space=space, through_camera=True)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera
    camera.matrix_world = Matrix.Translation((1, 2, 3)) @ Matrix.Rotation(0.7, 4, (3, 1, 2))
    bpy.context.view_layer.update()
    bpy.ops.livehand.import_motion(filepath=path, space=space, through_camera=True, start_frame=1)
    pose = read(hand, 2)
    wrist = np.array(hand.matrix_world @ Vector(model.joints[0] + pose.transl))
    seen = np.array(camera.matrix_world.inverted() @ Vector(wrist))
    of_file = model.joints[0] + motion_of(model.side).transl[1]
    # Each of the bones that carry the hand, and the camera, round metres of this size to single precision.
    rounding_m = 8 * np.spacing(np.float32(np.abs(wrist).max()))
    np.testing.assert_allclose(seen, of_file * ([1, -1, -1] if space == "opencv" else 1), rtol=0, atol=rounding_m)


def test_another_shape_keeps_the_wrist_position(hand, model, tmp_path):
    beta = np.linspace(-1, 1, 10)
    moving = motion_of(model.side, beta=beta)
    write_motion(moving, tmp_path / "m.npz")
    wrist = model.for_side(model.side)
    offset = np.einsum("v,vck,k->c", wrist.J_regressor[0], wrist.shapedirs, beta)
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "m.npz"), start_frame=1)
    np.testing.assert_allclose(read(hand, 2).transl, moving.transl[1] + offset, atol=1e-6)
    np.testing.assert_array_equal(read(hand, 2).beta, 0)
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "m.npz"), start_frame=1, set_shape=True)
    np.testing.assert_allclose(read(hand, 2).beta, beta, atol=1e-6)
    np.testing.assert_allclose(read(hand, 2).transl, moving.transl[1], atol=1e-6)


def test_the_motion_is_resampled_or_keyed_frame_by_frame(hand, model, tmp_path):
    theta = np.zeros((11, 16, 3))
    theta[:, 5, 0] = np.linspace(0, 1, 11)
    write_motion(motion_of(model.side, theta=theta, transl=np.zeros((11, 3)), fps=48.0), tmp_path / "fast.npz")
    bpy.context.scene.render.fps = 24
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "fast.npz"), start_frame=1)
    assert read(hand, 3).theta[5, 0] == pytest.approx(0.4, abs=1e-5)
    assert hand.animation_data.action.frame_range[1] == 6
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "fast.npz"), start_frame=1, match_fps=False)
    assert read(hand, 3).theta[5, 0] == pytest.approx(0.2, abs=1e-5)
    assert hand.animation_data.action.frame_range[1] == 11
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "fast.npz"), start_frame=1, fps=12)
    assert read(hand, 3).theta[5, 0] == pytest.approx(0.1, abs=1e-5)


def test_a_motion_of_the_other_side_is_rejected_or_mirrored(hand, model, tmp_path):
    other = motion_of("left" if model.side == "right" else "right")
    write_motion(other, tmp_path / "other.npz")
    with pytest.raises(RuntimeError, match="turn on Mirror"):
        bpy.ops.livehand.import_motion(filepath=str(tmp_path / "other.npz"))
    assert is_untouched(hand)
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "other.npz"), start_frame=1, mirror=True)
    np.testing.assert_allclose(read(hand, 2).theta, other.theta[1] * MIRROR_AXIS_ANGLE, atol=1e-5)


def test_wrist_rotation_and_location_can_be_left_unkeyed(hand, model, tmp_path):
    write_motion(motion_of(model.side), tmp_path / "m.npz")
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "m.npz"), start_frame=1, key_wrist=False, key_place=False)
    pose = read(hand, 2)
    np.testing.assert_allclose(pose.theta[1:], motion_of(model.side).theta[1, 1:], atol=1e-5)
    np.testing.assert_allclose(pose.theta[0], 0, atol=1e-6)
    np.testing.assert_allclose(pose.transl, 0, atol=1e-6)


def test_mean_and_components_need_a_mano_file(hand, model, tmp_path):
    rng = np.random.default_rng(3)
    mean, components = rng.normal(size=45) * 0.2, rng.normal(size=(45, 45)) * 0.1
    np.savez(tmp_path / "MANO_RIGHT.npz", hands_mean=mean, hands_components=components)
    raw = motion_of(model.side, seed=2)
    path = write_raw(tmp_path / "t.npz", raw)
    with pytest.raises(RuntimeError, match="got no MANO file"):
        bpy.ops.livehand.import_motion(filepath=path, mean="MISSING")
    assert is_untouched(hand)
    mano = str(tmp_path / "MANO_RIGHT.npz")
    bpy.ops.livehand.import_motion(filepath=path, mean="MISSING", angles="COMPONENTS", mano_path=mano, start_frame=1)
    sign = np.ones(3) if model.side == "right" else MIRROR_AXIS_ANGLE
    expected = (raw.theta[2, 1:].reshape(45) @ components + mean).reshape(15, 3) * sign
    np.testing.assert_allclose(read(hand, 3).theta[1:], expected, atol=1e-5)


def test_landmarks_are_fitted_onto_the_hand(hand, model, tmp_path):
    rest = HandSkeleton.of(load_default_hand()).rest[list(NODES_OF_LANDMARKS)]
    seen = rest if model.side == "right" else rest * [-1, 1, 1]
    label = "Left" if model.side == "right" else "Right"  # MediaPipe's label in a picture that is not mirrored
    np.savez(tmp_path / "l.npz", landmarks=np.tile(seen, (3, 1, 1)), handedness=label)
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "l.npz"), space="z_up", start_frame=1)
    pose = read(hand, 2)
    assert np.abs(pose.theta).max() < 0.2
    assert np.abs(pose.transl).max() < 0.004


def test_a_file_without_locations_only_rotates_the_hand(hand, model, tmp_path):
    hand.matrix_world = Matrix.Translation((0.3, -2, 1)) @ Matrix.Rotation(1.1, 4, (1, 2, 3))
    keyframe_transl(RiggedHand.of(hand), np.array([[0.01, 0.02, 0.03]]), [1])
    motion = motion_of(model.side)
    np.savez(tmp_path / "t.npz", poses=motion.theta.reshape(-1, 48), side=model.side)
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "t.npz"), space="y_up", start_frame=1)
    pose = read(hand, 2)
    np.testing.assert_allclose(pose.transl, (0.01, 0.02, 0.03), atol=1e-6)
    to_world = np.array(hand.matrix_world)[:3, :3] @ axis_angle_to_matrix(pose.theta[0])
    expected = TO_BLENDER["y_up"] @ axis_angle_to_matrix(motion.theta[1, 0])
    np.testing.assert_allclose(to_world, expected, atol=1e-5)


def test_several_files_of_one_frame_are_one_motion(hand, model, tmp_path):
    motion = motion_of(model.side, count=3)
    for k in range(3):
        np.savez(tmp_path / f"{k}.npz", poses=motion.theta[k].reshape(1, 48), side=model.side)
    files = [{"name": f"{k}.npz"} for k in (2, 0, 1)]
    bpy.ops.livehand.import_motion(directory=str(tmp_path), files=files, start_frame=1)
    np.testing.assert_allclose(read(hand, 3).theta, motion.theta[2], atol=1e-5)


@pytest.mark.parametrize(("fps", "first"), [(None, 21), (12.0, 41), (48.0, 11)])
def test_a_hand_that_comes_late_is_keyed_late(hand, model, tmp_path, fps, first):
    bpy.context.scene.render.fps = 24
    motion = motion_of(model.side)
    for index in range(26):
        poses = np.concatenate([motion.theta[index % 6].ravel(), motion.transl[index % 6]])
        (tmp_path / f"labels_{index:04d}.npz").unlink(missing_ok=True)
        np.savez(tmp_path / f"labels_{index:04d}.npz", pose_m=np.zeros((1, 51)) if index < 20 else poses[None])
    mano = tmp_path / "mano.npz"
    np.savez(mano, hands_mean=np.zeros(45), hands_components=np.eye(45))
    files = [{"name": f"labels_{index:04d}.npz"} for index in range(26)]
    options = {"fps": fps} if fps else {"match_fps": False}
    bpy.ops.livehand.import_motion(
        directory=str(tmp_path),
        files=files,
        start_frame=1,
        mano_path=str(mano),
        side=model.side,
        space="hand",
        **options,
    )
    keyed = hand.animation_data.action.frame_range
    assert keyed[0] == first
    wanted = motion.theta[20 % 6].copy()
    if model.side == "left":  # DexYCB's components are MANO's right ones, mirrored
        wanted[1:] *= MIRROR_AXIS_ANGLE
    np.testing.assert_allclose(axis_angle_to_matrix(read(hand, first).theta), axis_angle_to_matrix(wanted), atol=1e-4)


def test_a_failed_import_changes_nothing(hand, model, tmp_path):
    before = read(hand, 1)
    actions = len(bpy.data.actions)
    (tmp_path / "bad.npz").write_bytes(b"PK\x03\x04nothing")
    (tmp_path / "other.json").write_text('{"x": 1}')
    for name in ("bad.npz", "other.json", "gone.npz"):
        with pytest.raises(RuntimeError, match=name):
            bpy.ops.livehand.import_motion(filepath=str(tmp_path / name))
    assert is_untouched(hand)
    assert len(bpy.data.actions) == actions
    np.testing.assert_array_equal(read(hand, 1).theta, before.theta)


def test_what_speaks_against_an_imported_motion_is_told(hand, model, tmp_path, capfd):
    """A joint beyond its limits, a jump, another unit: warnings; a number that is none: an error, nothing keyed."""
    still = np.zeros((12, 16, 3))
    beyond, jump, broken = still.copy(), still.copy(), still.copy()
    beyond[:, 2] = [0, 1.0 if model.side == "right" else -1.0, 0]
    jump[6:, 0] = [0, 2.5, 0]
    broken[3, 4, 0] = np.nan
    cases = (
        (beyond, 0.1, ("index2 bend up to 24 degrees beyond what a hand can",)),
        (jump, 0.1, ("wrist turns by 143 degrees from its frame 6 to the next",)),
        (still, 300.0, ("m away: the unit may be another",)),
    )
    for theta, place, words in cases:
        np.savez(tmp_path / "bad.npz", theta=theta, transl=np.full((12, 3), place), fps=30.0, side=model.side)
        assert bpy.ops.livehand.import_motion(filepath=str(tmp_path / "bad.npz")) == {"FINISHED"}
        said = capfd.readouterr()
        for word in ("Check the motion", *words):
            assert word in said.out + said.err
    hand.animation_data_clear()
    np.savez(tmp_path / "bad.npz", theta=broken, side=model.side)
    with pytest.raises(RuntimeError, match="NaN"):
        bpy.ops.livehand.import_motion(filepath=str(tmp_path / "bad.npz"))
    assert is_untouched(hand)


def test_an_import_can_be_undone(model, tmp_path):
    bpy.ops.ed.undo_push(message="before")
    name = add_hand(bpy.context, model).name
    bpy.ops.ed.undo_push(message="hand")
    write_motion(motion_of(model.side), tmp_path / "m.npz")
    bpy.ops.livehand.import_motion("EXEC_DEFAULT", True, filepath=str(tmp_path / "m.npz"), start_frame=1)
    assert not is_untouched(bpy.data.objects[name])
    bpy.ops.ed.undo()
    assert is_untouched(bpy.data.objects[name])


def test_ten_thousand_frames_take_seconds_and_not_hours(tmp_path):
    """Five on a fast core; an import that is quadratic in the frames takes more than ten minutes."""
    add_hand(bpy.context, load_default_hand())
    steps = np.random.default_rng(0).normal(size=(10_000, 16, 3)) * 0.01
    write_motion(motion_of(theta=np.cumsum(steps, 0), transl=np.zeros((10_000, 3))), tmp_path / "m.npz")
    started = time.process_time()
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "m.npz"), start_frame=1)
    assert time.process_time() - started < 60


def test_import_and_export_need_a_hand(tmp_path):
    assert not bpy.ops.livehand.import_motion.poll()
    assert not bpy.ops.livehand.export_motion.poll()


class Layout:
    """Records labels and properties."""

    def __init__(self, drawn):
        self.drawn = drawn

    def box(self):
        return self

    def column(self, align=False):
        return self

    def panel(self, name, default_closed=False) -> tuple:
        assert default_closed
        return self, self

    def label(self, text):
        self.drawn.append(text)

    def prop(self, owner, name):
        self.drawn.append(name)


def test_the_file_browser_shows_the_detected_format(tmp_path):
    np.savez(tmp_path / "labels.npz", pose_m=np.ones((1, 51)))
    (tmp_path / "bad.npz").write_bytes(b"nothing")
    operator = LIVEHAND_OT_import_motion

    class Browser:
        draw, _detected, _paths = operator.draw, operator._detected, operator._paths
        draw_settings = operator.draw_settings
        directory, files = "", ()

        def __init__(self, path):
            self.filepath, self.layout = str(path), Layout([])

    drawn_by_name = {}
    for name in ("labels.npz", "bad.npz", "gone.npz"):
        browser = Browser(tmp_path / name)
        for _ in range(2):  # as often as Blender redraws
            browser.layout.drawn.clear()
            browser.draw(bpy.context)
        drawn_by_name[name] = browser.layout.drawn
    assert "Format: DexYCB" in drawn_by_name["labels.npz"]
    assert "Angles: 45 components (needs a MANO file)" in " ".join(drawn_by_name["labels.npz"])
    assert max(map(len, drawn_by_name["labels.npz"])) <= 40  # wider lines would be cut off
    assert "readable .npz" in " ".join(drawn_by_name["bad.npz"])
    assert "Choose a file" in drawn_by_name["gone.npz"]
    declared = set(bpy.ops.livehand.import_motion.get_rna_type().properties.keys())
    drawn = {name for name in drawn_by_name["gone.npz"] if name.islower()}
    assert drawn <= declared
    assert declared - drawn == {"rna_type", "filepath", "directory", "files", "filter_glob"}


def test_the_file_browser_opens_beside_the_blend_proposes_no_file_and_shows_four_settings(tmp_path):
    """Blender itself would propose `shot.blend`; a directory that is set has no file."""
    operator = LIVEHAND_OT_import_motion
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))

    class Closed(Layout):
        def panel(self, name, default_closed=False):
            return self, None

    class Browser:
        invoke, draw, _detected, _paths = operator.invoke, operator.draw, operator._detected, operator._paths
        draw_settings, files, filepath = operator.draw_settings, (), ""

        def __init__(self, directory):
            self.directory, self.layout = directory, Closed([])

        def invoke_popup(self, context):
            return {"RUNNING_MODAL"}

    fresh, dropped = Browser(""), Browser("/dropped/from/")
    for browser in (fresh, dropped):
        assert browser.invoke(bpy.context, None) == {"RUNNING_MODAL"}
    assert Path(fresh.directory) == tmp_path
    assert dropped.directory == "/dropped/from/"
    fresh.draw(bpy.context)
    assert fresh.layout.drawn == ["Choose a file", "start_frame", "match_fps", "mirror", "Advanced"]


def test_dropped_files_start_the_import():
    handlers = {
        name: getattr(bpy.types, name) for name in ("LIVEHAND_FH_poses", "LIVEHAND_FH_landmarks", "LIVEHAND_FH_rigs")
    }
    suffixes = ";".join(handler.bl_file_extensions for handler in handlers.values()).split(";")
    assert sorted(suffixes) == sorted([".csv", ".json", ".jsonl", ".npy", ".npz", ".pkl", *RIG_SUFFIXES])
    assert {handler.bl_import_operator for handler in handlers.values()} == {LIVEHAND_OT_import_motion.bl_idname}


def test_keys_override_a_written_pose(hand, model, tmp_path):
    """As always in Blender, keys override values set without keying."""
    motion = motion_of(model.side)
    write_motion(motion, tmp_path / "m.npz")
    bpy.ops.livehand.import_motion(filepath=str(tmp_path / "m.npz"), start_frame=1)
    write_hand_pose(RiggedHand.of(hand), motion.pose(4))
    np.testing.assert_allclose(read(hand, 2).theta, motion.theta[1], atol=1e-5)


def test_picture_landmarks_come_through_the_camera_or_not_at_all(hand, model, tmp_path):
    """A hand half a metre before the scene's camera is keyed there; without the camera nothing is."""
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 640, 480, 100
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera, camera.data.angle_x = camera, np.deg2rad(50)
    skeleton = HandSkeleton.of(model)
    mirror = np.array([1.0, 1, 1]) if model.side == "right" else np.array([-1.0, 1, 1])
    seen = (skeleton.rest[list(NODES_OF_LANDMARKS)] * mirror)[:, [2, 0, 1]]
    seen = seen - seen[0] + [0, 0.05, 0.5]
    focal_px = 320 / np.tan(np.deg2rad(25))
    picture = np.stack(
        [
            seen[:, 0] / seen[:, 2] * focal_px / 640 + 0.5,
            seen[:, 1] / seen[:, 2] * focal_px / 480 + 0.5,
            (seen[:, 2] - 0.5) / 0.5 * focal_px / 640,
        ],
        1,
    )
    np.savez(tmp_path / "take.npz", landmarks=np.tile(picture, (2, 1, 1)))
    with pytest.raises(RuntimeError, match="must hold world landmarks"):
        bpy.ops.livehand.import_motion(filepath=str(tmp_path / "take.npz"), side=model.side)
    assert is_untouched(hand)
    bpy.ops.livehand.import_motion(
        filepath=str(tmp_path / "take.npz"), side=model.side, through_camera=True, start_frame=1, key_place=True
    )
    wrist = read(hand, 1).transl + model.joints[0]
    np.testing.assert_allclose(wrist, [0, -0.05, -0.5], atol=0.05)


@pytest.fixture
def filmed(tmp_path, model):
    """A function (frames) -> path of a take of an open hand that rises before a camera, and the fit of it."""

    def write(frames=range(60), fps=24.0):
        angles = np.zeros((60, 5, 3, 3))
        root = np.broadcast_to(np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]), (60, 3, 3))
        wrist = np.linspace([0, 0.12, 0.5], [0, 0.02, 0.5], 60)
        skeleton = HandSkeleton.of(load_default_hand())
        nodes = skeleton.pose(root, wrist, angles, skeleton.offsets(np.zeros(10))).nodes[:, NODES_OF_LANDMARKS]
        px, kept = nodes[..., :2] / nodes[..., 2:] * 600 + (320, 240), np.array(frames)
        hand = FilmedHand(kept, px[kept], (nodes - nodes.mean(1, keepdims=True))[kept])
        take = FilmedTake(FilmCamera((640, 480), 600.0), np.arange(60) / fps, fps, {"right": hand})
        write_take(take, tmp_path / "take.npz")
        return str(tmp_path / "take.npz"), open_motion_file(tmp_path / "take.npz").fit(load_default_hand())

    return write


def test_a_filmed_take_is_keyed_where_its_camera_saw_it(hand, filmed):
    path, fit = filmed()
    bpy.context.scene.render.fps = 24
    assert bpy.ops.livehand.import_motion(filepath=path, start_frame=11, mirror=True) == {"FINISHED"}
    pose = read(hand, 40)
    motion = fit.motion if pose.side == "right" else mirrored(fit.motion)
    np.testing.assert_allclose(pose.theta[1:], motion.theta[29, 1:], atol=1e-5)
    assert 0.3 < pose.transl[1] < 0.7  # in front of a camera at the origin that looks along +Y
    assert [marker.name for marker in bpy.context.scene.timeline_markers if "no hand" in marker.name] == []


def test_a_long_gap_has_no_keys_and_a_marker(hand, filmed):
    path, _fit = filmed([*range(5, 20), *range(40, 60)])
    bpy.context.scene.render.fps = 24
    bpy.ops.livehand.import_motion(filepath=path, start_frame=1, mirror=True)
    action = hand.animation_data.action
    curve = next(iter(action.layers[0].strips[0].channelbags[0].fcurves))
    keys = [int(point.co[0]) for point in curve.keyframe_points]
    assert keys == [*range(6, 21), *range(41, 61)]
    lost = [marker.frame for marker in bpy.context.scene.timeline_markers if "no hand" in marker.name]
    assert lost == [21]
    bpy.ops.livehand.import_motion(filepath=path, start_frame=1, mirror=True)
    assert [marker.frame for marker in bpy.context.scene.timeline_markers if "no hand" in marker.name] == lost
