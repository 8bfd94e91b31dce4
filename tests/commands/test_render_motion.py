"""`livehand render` of a pose file: what is posed, what the camera holds, what is written."""

import argparse
import json
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.avatars.library import avatar_path
from livehand.backend.avatars.origin import read_origin
from livehand.backend.batch.content_credentials import read_manifest
from livehand.backend.capture.exr import read_exr
from livehand.backend.commands.render_motion import (
    add_arguments,
    frame_indices,
    posed_upright,
    run,
    sampled_vertices,
)
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_arrays, posed_vertices
from livehand.backend.hand.model_file import builtin_hand_path, load_hand_model
from livehand.backend.image.frame_writer import write_png
from livehand.backend.image.watermark.detection import read_watermark
from livehand.backend.motion.formats.own import write_motion
from livehand.backend.motion.landmarks.sighting import MEDIAPIPE_IN_WEBXR
from livehand.backend.motion.landmarks.skeleton import NODES_OF_LANDMARKS, HandSkeleton
from livehand.backend.motion.motion import HandMotion
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import Frame
from livehand.livehand_blender.cli import main
from PIL import Image
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.slow


@pytest.fixture
def gestures(tmp_path):
    axes = FingerAxes.of_default_hand()
    theta = np.array([theta_of(GESTURES[name].angles_deg(), axes) for name in ("open", "fist")])
    path = tmp_path / "gestures.npz"
    write_motion(HandMotion(theta, np.linspace(-1, 1, 10), np.array([[1.0, 2, 3], [4, 5, 6]]), side="left"), path)
    return path


def test_a_hand_in_its_own_space_stands_upright_with_its_wrist_at_the_origin(hand, gestures):
    motion, _ = posed_upright(gestures, hand)
    for index in range(2):
        vertices, joints = posed_arrays(hand, motion.pose(index))
        np.testing.assert_allclose(joints[0], 0, atol=1e-9)
        assert joints[4, 2] > 0.05  # the middle knuckle above the wrist
        assert vertices[:, 2].max() > joints[4, 2]
    assert motion.side == "left"


def test_the_forearm_of_a_file_turns_the_arm_in_the_picture(hand, tmp_path):
    armed = replace(hand, arm_weights=hand.lbs_weights[:, 0] * (hand.v_template[:, 0] > hand.joints[0, 0]))
    write_motion(
        HandMotion(np.zeros((2, 16, 3)), np.zeros(10), np.zeros((2, 3)), forearm=np.eye(3)[:2]), tmp_path / "m.npz"
    )
    motion, _ = posed_upright(tmp_path / "m.npz", armed)
    straight = replace(motion, forearm=np.zeros(3))
    moved = np.abs(posed_vertices(armed, motion.pose(1)) - posed_vertices(armed, straight.pose(1))).max(1)
    assert moved[armed.arm_weights == 0].max() == 0
    assert moved[armed.arm_weights == 1].max() > 0.01


@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("ahead", [1, -1])
def test_a_headsets_take_is_seen_from_the_fingers_not_from_the_stump(hand, tmp_path, side, ahead):
    """WebXR: Y up, and the wearer, who looks along -Z, stretches the hand out ahead."""
    model = hand.for_side(side)
    rest = HandSkeleton.of(hand).rest[list(NODES_OF_LANDMARKS)] * ([1, 1, 1] if side == "right" else [-1, 1, 1])
    along = (model.joints[4] - model.joints[0]) / np.linalg.norm(model.joints[4] - model.joints[0])
    turn = Rotation.align_vectors([[0, 0, -ahead], [0, 1, 0]], [along, [0, 1, 0]])[0].as_matrix()
    joints = np.full((2, 25, 3), 9.0)
    joints[:, list(MEDIAPIPE_IN_WEBXR)] = rest @ turn.T + [0.1, 1.2, -0.4]
    np.savez(tmp_path / "take.npz", joints=joints, handedness=side)
    motion, _ = posed_upright(tmp_path / "take.npz", hand)
    assert motion.side == side
    knuckle = posed_arrays(hand, motion.pose(0))[1][4]
    np.testing.assert_allclose(knuckle[:2] / np.linalg.norm(knuckle), [0, -1], atol=0.2)  # towards the camera
    assert posed_vertices(hand, motion.pose(0))[:, 2].max() < 0.06  # as level as it was


def test_the_hand_reaches_as_far_as_in_all_its_frames(hand, gestures):
    motion, _ = posed_upright(gestures, hand)
    both = [posed_vertices(hand, motion.pose(index))[hand.framed_vertices] for index in (0, 1)]
    np.testing.assert_array_equal(sampled_vertices(motion, [0, 1], hand), np.concatenate(both))
    many = HandMotion(np.zeros((1000, 16, 3)), np.zeros(10), np.zeros((1000, 3)))
    assert len(sampled_vertices(many, list(range(1000)), hand)) == 200 * len(hand.v_template[hand.framed_vertices])


def test_frames_count_from_one():
    motion = HandMotion(np.zeros((3, 16, 3)), np.zeros(10), np.zeros((3, 3)))
    assert frame_indices(motion, None) == [0, 1, 2]
    assert frame_indices(motion, (3, 1)) == [2, 0]
    with pytest.raises(LiveHandError, match=r"in 1-3, as the hand's in the file do, got \[0, 4\]"):
        frame_indices(motion, (0, 2, 4))


def test_frames_of_a_hand_that_comes_late_are_the_files():
    motion = HandMotion(np.zeros((3, 16, 3)), np.zeros(10), np.zeros((3, 3)))
    assert frame_indices(motion, (22, 23), first=20) == [1, 2]
    with pytest.raises(LiveHandError, match=r"in 21-23, as the hand's in the file do, got \[1\]"):
        frame_indices(motion, (1, 21), first=20)


def test_pngs_are_srgb_with_straight_alpha(tmp_path):
    alpha = np.array([[1.0, 0.5], [0, 1]], np.float32)
    linear = np.full((2, 2, 3), 0.2, np.float32)
    write_png(Frame(linear * alpha[..., None], alpha, alpha), tmp_path / "a.png")
    pixels = np.asarray(Image.open(tmp_path / "a.png"))
    np.testing.assert_array_equal(pixels[..., 3], [[255, 128], [0, 255]])
    encoded = round(255 * (1.055 * 0.2 ** (1 / 2.4) - 0.055))
    assert (pixels[alpha > 0][:, :3] == encoded).all()
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def my_hand(folder):
    """The built-in hand in a file of its own, which makes it another hand."""
    with np.load(builtin_hand_path()) as arrays:
        np.savez(folder / "mine.npz", **{**arrays, "mine": np.ones(1)})
    return folder / "mine.npz"


def test_a_hand_of_ones_own_is_rendered_by_its_own_avatar(gestures, tmp_path):
    hand = my_hand(tmp_path)
    avatar = replace(load_avatar(), surface=None)  # that of the built-in hand is not another hand's
    save_avatar(avatar, tmp_path / "stranger.safetensors")
    save_avatar(replace(avatar, hand_sha256=load_hand_model(hand).sha256), tmp_path / "mine.safetensors")
    for folder, arguments in (
        ("own", ["--hand", str(hand), "--avatar", str(tmp_path / "mine.safetensors")]),
        ("built_in", ["--avatar", str(tmp_path / "stranger.safetensors")]),
    ):
        asked = ["render", str(gestures), "-o", str(tmp_path / folder), "--size", "48x64", "--frames", "1", *arguments]
        assert main(asked) == 0
    own, built_in = (np.asarray(Image.open(tmp_path / folder / "0001.png")) for folder in ("own", "built_in"))
    np.testing.assert_array_equal(own, built_in)


def test_every_line_is_json_if_asked(gestures, tmp_path, capsys):
    assert main(["render", str(gestures), "-o", str(tmp_path / "out"), "--size", "48x64", "--json"]) == 0
    opened, *events, result = map(json.loads, capsys.readouterr().out.splitlines())
    assert (opened["event"], opened["folder"], opened["frames"]) == ("shot", str(tmp_path / "out"), 2)
    assert [(event["event"], event["frame"], event["count"]) for event in events] == [("frame", 1, 2), ("frame", 2, 2)]
    assert (result["frames"], result["written"], result["files"][0]["file"]) == (2, 2, str(gestures))


def test_the_hand_is_in_a_studios_light(gestures, tmp_path):
    """One key lamp: the hand has a lit and a dark side, which it has not in its capture's dome."""
    assert main(["render", str(gestures), "-o", str(tmp_path / "out"), "--frames", "1"]) == 0
    pixels = np.asarray(Image.open(tmp_path / "out" / "0001.png")).astype(float)
    grey = np.where(pixels[..., 3] > 250, pixels[..., :3].mean(-1), np.nan)
    assert np.nanpercentile(grey, 95) > 2.5 * np.nanpercentile(grey, 5)


def test_pictures_tell_their_avatar_and_are_signed(gestures, tmp_path, signer):
    pytest.importorskip("c2pa")
    options = ["--watermark", "--certificate", str(signer[0]), "--private-key", str(signer[1]), "--avatar", "deep"]
    command = ["render", str(gestures), "-o", str(tmp_path / "out"), "--frames", "1", "--size", "334x512", *options]
    assert main(command) == 0
    path, deep = tmp_path / "out" / "0001.png", read_origin(avatar_path("deep"))
    with Image.open(path) as picture:
        pixels = np.asarray(picture, np.float32)
        assert picture.info["LiveHand/Avatar"] == "deep"
    seen = (pixels[..., :3] * (pixels[..., 3:] / 255)).round().astype(np.uint8)
    assert read_watermark(seen, (1.0,)).agreement(deep.payload) == 64
    assert read_manifest(path).origin["avatars"] == [{"name": "deep", "licence": deep.licence, "consent": ""}]


def test_frames_of_a_marked_avatar_are_marked_unasked(gestures, tmp_path):
    marked = tmp_path / "marked.safetensors"
    assert main(["watermark", str(avatar_path("deep")), "-o", str(marked)]) == 0
    command = ["render", str(gestures), "-o", str(tmp_path / "out"), "--frames", "1", "--size", "334x512"]
    assert main([*command, "--avatar", str(marked)]) == 0
    pixels = np.asarray(Image.open(tmp_path / "out" / "0001.png"), np.float32)
    seen = (pixels[..., :3] * (pixels[..., 3:] / 255)).round().astype(np.uint8)
    assert read_watermark(seen, (1.0,)).agreement(read_origin(avatar_path("deep")).payload) == 64


def test_a_pose_file_is_rendered_to_images(gestures, tmp_path):
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    asked = {"shots": [gestures], "output": tmp_path / "out", "frames": (2,), "avatar": None, "size": (48, 64)}
    whole = {
        "jobs": 1,
        "chunk": argparse.Namespace(count=1),
        "device": "cpu",
        "precision": None,
        "json": False,
        "format": None,
    }
    whole |= {"watermark": False, "certificate": None, "private_key": None}
    args = argparse.Namespace(**asked, **whole, **vars(parser.parse_args(["--side", "right"])))
    result = run(args)
    assert (result["frames"], result["folder"]) == (1, str(tmp_path / "out"))
    (picture,) = (tmp_path / "out").iterdir()
    assert picture.name == "0002.png"
    pixels = np.asarray(Image.open(picture))
    assert pixels.shape == (64, 48, 4)
    assert 0.1 < (pixels[..., 3] > 128).mean() < 0.9
    args.format = ("exr", "png")
    assert run(args)["frames"] == 1
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"0002.png", "0002.exr"}
    alpha = read_exr(tmp_path / "out" / "0002.exr")["A"]
    assert np.abs(alpha - pixels[..., 3] / 255).max() < 0.01
    args.hand = my_hand(tmp_path)
    with pytest.raises(LiveHandError, match="must be given its own hand model"):
        run(args)
    args.hand = None
    args.shots *= 2
    with pytest.raises(LiveHandError, match="give one file, and no --jobs or --chunk"):
        run(args)
