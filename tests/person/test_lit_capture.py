"""A capture in the light that its person finds: rendered pictures in a known light, with cameras of several colours."""

import json
from dataclasses import dataclass, replace

import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.capture.capture import Capture, CaptureView, load_capture, save_capture_index
from livehand.backend.capture.check import check_capture
from livehand.backend.capture.picture import linear_to_srgb
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.person.lit_capture import write_lit_capture
from livehand.backend.person.lit_model.model import PersonModel
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Light, Sky, sky_directions
from livehand.backend.records.shot import HandPose
from livehand.backend.surface.surface_file import surface_sha256
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS
from PIL import Image

pytest.importorskip("cv2")
pytestmark = pytest.mark.nightly  # half a minute; `test_captured_pictures` has its parts
SIZE_PX, FOCAL_PX = (120, 150), 240.0
OFF_M = np.array([0.002, -0.001, 0.002])
TINT, GAINS = np.array([1.1, 1.0, 0.8]), np.array([[1.0, 1, 1], [0.7, 0.75, 0.8], [1.15, 1.0, 1.0]])


@dataclass(frozen=True)
class Shown:
    """The person, and the capture of theirs: its folder, and what is true of it."""

    person: object
    folder: object
    poses: list
    light: Light


@pytest.fixture(scope="module")
def shown(tmp_path_factory):
    """Three cameras' pictures of two poses; the second is held out, and what the capture says of them is off."""
    hand, avatar = load_default_hand(), load_avatar(shipped_avatar_path("middle"))
    model, folder = PersonModel.of(avatar, hand), tmp_path_factory.mktemp("shown")
    beta = np.array(avatar.surface.person.beta)
    up = sky_directions(16, 32)
    light = Light(sky=Sky((0.15 + 0.4 * (up @ [0.5, -0.5, 0.7]).clip(0))[..., None] * TINT))
    poses, views = [], []
    for row, gesture in enumerate(("rest", "relaxed")):
        theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand())
        poses.append(HandPose(theta, beta, -rest_wrists(hand, beta)))
        middle = posed_vertices(hand, poses[0])[hand.framed_vertices].mean(0)
        for column, gain in enumerate(GAINS):
            angle = 0.4 + 0.7 * column
            eye = middle + 0.42 * np.array([0.2, np.cos(angle), np.sin(angle)])
            K = np.array([[FOCAL_PX, 0, SIZE_PX[0] / 2], [0, FOCAL_PX, SIZE_PX[1] / 2], [0, 0, 1]])
            camera = Camera(K, look_at(eye, middle, np.array([-1.0, 0, 0])), SIZE_PX)
            frame = model.rendered(poses[row], camera, light)
            linear = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3) * gain
            pixels = np.concatenate([linear_to_srgb(linear.clip(0, 1).astype(np.float32)), frame.alpha[..., None]], -1)
            view = CaptureView(f"{row}_{column}.png", camera, column, row, "novel_pose" if row else "train")
            Image.fromarray((255 * pixels).round().clip(0, 255).astype(np.uint8)).save(folder / view.file)
            views.append(view)
    said = tuple(replace(pose, beta=np.zeros(10), transl=pose.transl + OFF_M) for pose in poses)
    save_capture_index(Capture(folder, hand.sha256, {}, said, tuple(views)))
    return Shown(avatar, folder, poses, light)


@pytest.fixture(scope="module")
def written(shown, hand, tmp_path_factory):
    output = tmp_path_factory.mktemp("lit") / "capture"
    write_lit_capture(shown.folder, shown.person, hand, None, output)
    return load_capture(output)


def test_it_is_a_capture_with_lights_and_the_persons_surface(shown, hand, written):
    check_capture(written, hand)
    assert [view.split for view in written.views] == ["train"] * 3 + ["novel_pose"] * 3
    assert written.surface.sha256 == surface_sha256(shown.person.surface)
    assert len(written.lights) == 1


def test_the_person_in_that_light_is_what_the_pictures_show(shown, hand, written):
    """Both of the training pose and of the held-out one, in one exposure, whatever the cameras' colours were."""
    model = PersonModel.of(shown.person, hand)
    for view in written.views:
        pose = written.poses[view.pose_index]
        np.testing.assert_allclose(pose.beta, shown.person.surface.person.beta)
        frame, truth = model.rendered(pose, view.camera, written.light_of(view)), written.read_linear(view)
        sure = (truth[..., 3] > 0.99) & (frame.alpha > 0.99)
        off = np.log(frame.rgb[sure] + 0.01) - np.log(truth[sure][:, :3] + 0.01)
        assert sure.mean() > 0.05
        assert np.abs(np.median(off, 0)).max() < 0.06
        assert np.abs(off).mean() < 0.12


def test_poses_go_to_where_the_pictures_show_the_hand(shown, hand, written):
    for pose, truth in zip(written.poses, shown.poses, strict=True):
        off = posed_vertices(hand, pose) - posed_vertices(hand, truth)
        assert np.linalg.norm(off[hand.framed_vertices].mean(0)) < 0.0015  # said: 3 mm


def test_what_is_no_person_is_refused(shown, hand, tmp_path):
    with pytest.raises(LiveHandError, match="must be a person of 'hand_with_arm'"):
        write_lit_capture(shown.folder, replace(shown.person, surface=None), hand, None, tmp_path / "lit")


@pytest.mark.nightly
def test_training_goes_on_from_the_person_and_says_what_it_brought(shown, tmp_path, capsys):
    output = tmp_path / "more.safetensors"
    arguments = ["train", str(shown.folder), "--person", "middle", "-o", str(output), "--steps", "2", "--device", "cpu"]
    options = ["--perceptual", "0", "--preview-minutes", "0", "--json"]
    assert run_commands("livehand", "", COMMANDS, [*arguments, *options]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["held_out_before_db"] > 24
    assert result["brought_db"] > -3
    trained = load_avatar(output)
    assert surface_sha256(trained.surface) == surface_sha256(shown.person.surface)
    assert trained.provenance["fine_tuned_from"]["name"] == shown.person.name
