"""A data set in InterHand2.6M's layout, of rendered pictures and a twin's poses, becomes pictures of the built-in hand.

The truth is the built-in hand's: its poses, light and cameras make the pictures. The twin, another model of MANO's
format, is fitted to it, as the data set's fits are to its people. Cameras have colours of their own.
"""

import json
import shutil
from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch
from livehand.backend.capture.capture import load_capture, save_capture_index
from livehand.backend.capture.importers.interhand_capture import InterHandRequest, import_interhand
from livehand.backend.capture.masks.mask import MaskConfig
from livehand.backend.capture.masks.mask_capture import mask_capture
from livehand.backend.capture.picture import linear_to_srgb
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import SkinTensors, posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.person.camera_gains import relative_gains
from livehand.backend.person.captured_pictures import chosen_views, pictures_of_capture
from livehand.backend.person.fit.refit import refitted
from livehand.backend.person.lit_model.illumination import Illumination, fitted_light, lit_pixels
from livehand.backend.person.lit_model.picture_lights import PictureIlluminations
from livehand.backend.person.sources import PictureSource, pictured_hand
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.hand_picture import HAND
from livehand.backend.records.light import Light, Sky, sky_directions
from livehand.backend.records.shot import HandPose
from livehand.backend.rigs.model_transfer.point_fit import FitPrior, PointGoals, fitted_to_points
from livehand.tests.mano_twin import ManoTwin, write_twin
from livehand.tests.person.conftest import drawn, middle_person
from PIL import Image

pytest.importorskip("cv2")
pytestmark = pytest.mark.slow
SIZE_PX, FOCAL_PX = (124, 190), 300.0  # of the data set's shape
CAMERAS = ("400262", "400263", "400264", "400265", "400266", "400412", "410001")
SWAPPED, GREY = "400412", "410001"
GAINS = np.array([[1.0, 1, 1], [1.25, 1.0, 0.85], [0.8, 0.85, 0.95], [1, 1.1, 1.2], [0.9, 0.9, 0.9], [1.1, 1.0, 1.0]])
GESTURES_SHOWN = ("rest", "relaxed", "spread")


@dataclass(frozen=True)
class Truth:
    """What made the pictures: the twin and its fits, the built-in hand's poses, cameras, and linear colours."""

    twin: ManoTwin
    fits: list
    poses: list
    cameras: list
    images: dict


@pytest.fixture(scope="module")
def truth(tmp_path_factory):
    twin = write_twin(tmp_path_factory.mktemp("twin") / "MANO_RIGHT.npz")
    person = middle_person()
    ours, rng = person.hand, np.random.default_rng(2)
    beta = rng.normal(0, 0.5, 10)
    up = sky_directions(16, 32)
    light = Light(sky=Sky(np.repeat(0.2 + 0.35 * (up @ [0.6, 0.3, 0.74]).clip(0)[..., None], 3, 2)))
    poses, fits, images = [], [], {}
    wrist = rest_wrists(ours, beta)
    for index, gesture in enumerate(GESTURES_SHOWN):
        theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand(), np.array([0.2, 0.1 * index, 0]))
        poses.append(HandPose(theta, beta, np.array([0.3, -0.2, 1.1]) - wrist))
        fits.append(twin_fit(twin, posed_vertices(ours, poses[-1])))
    middle = posed_vertices(ours, poses[0])[ours.framed_vertices].mean(0)
    cameras = [camera_around(middle, 2 * np.pi * index / len(CAMERAS)) for index in range(len(CAMERAS))]
    for row, pose in enumerate(poses):
        for column, camera in enumerate(cameras):
            frame = person.rendered(pose, camera, light)
            images[row, column] = frame.rgb, frame.alpha[..., None]
    return Truth(twin, fits, poses, cameras, images)


def twin_fit(twin, vertices):
    """The twin's pose and shape that is nearest to the built-in hand's posed vertices."""
    goal = vertices[twin.vertex]
    every = np.arange(len(goal))
    goals = PointGoals(every, goal, np.tile([0.0, 0, 1], (len(goal), 1)), np.ones(len(goal)))
    start = HandPose(np.zeros((16, 3)), np.zeros(10), goal.mean(0) - twin.model.v_template.mean(0))
    skin = SkinTensors.of(twin.model, dtype=torch.float64)
    return fitted_to_points(skin, start, goals, FitPrior(1.0, 1.0, 2.0), steps=40)


def camera_around(middle, angle):
    eye = middle + 0.5 * np.array([0.25, np.cos(angle), np.sin(angle)])
    K = np.array([[FOCAL_PX, 0, SIZE_PX[0] / 2], [0, FOCAL_PX, SIZE_PX[1] / 2], [0, 0, 1]])
    return Camera(K, look_at(eye, middle, np.array([-1.0, 0, 0])), SIZE_PX)


def write_data_set(truth, root):
    """The files as the data set's pages describe them: millimetres, fits relative to the mean pose."""
    entry = {"campos": {}, "camrot": {}, "focal": {}, "princpt": {}}
    for name, camera in zip(CAMERAS, truth.cameras, strict=True):
        entry["camrot"][name] = camera.cam2world[:3, :3].T.tolist()
        entry["campos"][name] = (1000 * camera.origin).tolist()
        entry["focal"][name], entry["princpt"][name] = camera.K[[0, 1], [0, 1]].tolist(), camera.K[:2, 2].tolist()
    fits, images, annotations = {}, [], []
    for row, fit in enumerate(truth.fits):
        relative = fit.theta - np.r_[np.zeros((1, 3)), truth.twin.hands_mean]
        pose = {"pose": relative.ravel().tolist(), "shape": fit.beta.tolist(), "trans": fit.transl.tolist()}
        fits[str(row)] = {"right": pose, "left": None}
        for column, name in enumerate(CAMERAS):
            number, file = len(images), f"Capture0/ROM/cam{name}/image{row}.jpg"
            about = {"capture": 0, "subject": 1, "seq_name": "ROM", "camera": name, "frame_idx": row}
            images.append({"id": number, "file_name": file, "width": SIZE_PX[0], "height": SIZE_PX[1], **about})
            annotations.append({"id": number, "image_id": number, "hand_type": "right", "hand_type_valid": 1})
            path = root / "images/test" / file
            path.parent.mkdir(parents=True, exist_ok=True)
            picture(truth, row, column).save(path, quality=97, subsampling=0)
    documents = {
        "data": {"images": images, "annotations": annotations},
        "camera": {"0": entry},
        "MANO_NeuralAnnot": {"0": fits},
    }
    (root / "annotations").mkdir()
    for name, document in documents.items():
        (root / "annotations" / f"InterHand2.6M_test_{name}.json").write_text(json.dumps(document))
    return InterHandRequest(root, root / "annotations", "test", 0, held_out_frames=1, held_out_cameras=[])


def picture(truth, row, column):
    rgb, alpha = truth.images[row, column]
    gain = GAINS[min(column, len(GAINS) - 1)]
    linear = rgb * gain + (1 - alpha) * 0.02
    encoded = (255 * linear_to_srgb(linear.clip(0, 1).astype(np.float32))).round().astype(np.uint8)
    image = Image.fromarray(encoded)
    if CAMERAS[column] == GREY:
        return image.convert("L")
    return image.resize(SIZE_PX[::-1]) if CAMERAS[column] == SWAPPED else image


@pytest.fixture(scope="module")
def folder(truth, tmp_path_factory):
    """The imported capture with its masks."""
    root = tmp_path_factory.mktemp("interhand")
    request = write_data_set(truth, root)
    capture = root / "capture"
    import_interhand(request, truth.twin.model, truth.twin.hands_mean, capture)
    mask_capture(capture, truth.twin.model, MaskConfig(erode_mm=4.0, dilate_mm=12.0))
    return capture


@pytest.fixture(scope="module")
def read(truth, folder, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_DATA_HOME", str(tmp_path_factory.mktemp("data")))
        return pictures_of_capture(folder, load_default_hand(), 40, truth.twin.model, lambda line: None)


def off_m(truth, hand, pictures, of_vertex):
    """Mean distance of the pictures' posed hand from the truth's, of some vertices."""
    found = []
    for one in pictures:
        goal = posed_vertices(hand, truth.poses[one.moment])
        found.append(np.linalg.norm(posed_vertices(hand, one.pose) - goal, axis=1)[of_vertex].mean())
    return float(np.mean(found))


def moved_by(one, shift):
    return replace(one, pose=replace(one.pose, transl=one.pose.transl + shift))


def overlap(hand, pictures):
    shares = []
    for one in pictures:
        ours = drawn(posed_vertices(hand, one.pose), hand.f, one.camera)
        known = one.labels != 2
        ours, theirs = ours & known, one.labels == HAND
        shares.append((ours & theirs).sum() / (ours | theirs).sum())
    return float(np.mean(shares))


def test_poses_are_the_built_in_hands(truth, hand, read):
    assert len(read.pictures) == 3 * (len(CAMERAS) - 1)
    assert {one.moment for one in read.pictures if one.is_held_out} == {2}
    is_hand = hand.arm_weights == 0
    assert off_m(truth, hand, read.pictures, is_hand) < 0.0022
    assert overlap(hand, read.pictures) > 0.93
    assert "both surfaces are" in " ".join(read.notes)
    assert read.offset_m.shape == (len(hand.v_template),)
    for one in read.pictures:
        assert one.camera.size_px == (one.rgb.shape[1], one.rgb.shape[0])


def test_a_fit_that_no_hand_can_have_is_left_out(truth, hand, folder, read, tmp_path, monkeypatch):
    """Its beta is as wild as those of bad fits in data sets are; the shape stays that of the others."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    shutil.copytree(folder, tmp_path / "wild")
    capture = load_capture(tmp_path / "wild")
    wild = replace(capture.poses[1], beta=12 * np.array([0.4, -0.2, -0.4, 0.8, -0.7, 1, 2.4, -2, 0.4, 0]))
    save_capture_index(replace(capture, poses=(capture.poses[0], wild, capture.poses[2])))
    pictures = pictures_of_capture(tmp_path / "wild", hand, 40, truth.twin.model, lambda line: None)
    assert {one.moment for one in pictures.pictures} == {0, 2}
    assert "1 of 3 poses are left out, whose fits no such hand can have: 1" in " ".join(pictures.notes)
    kept = [one for one in read.pictures if one.moment != 1]
    is_hand = hand.arm_weights == 0
    assert off_m(truth, hand, pictures.pictures, is_hand) < off_m(truth, hand, kept, is_hand) + 0.0003


def test_gains_of_the_cameras_come_back(read):
    """The last of the cameras in colour is the one with swapped sides."""
    found = {one.camera_index: np.array(one.log_gain) for one in read.pictures}
    truth = np.log(GAINS) - np.log(GAINS).mean(0)
    off = np.abs([found[index] for index in sorted(found)] - truth)
    assert off.max() < 0.16
    assert off.mean() < 0.7 * np.abs(truth).mean()


@pytest.mark.nightly
def test_refit_shares_poses_and_brings_the_hand_back(truth, hand, read):
    """From poses that are some millimetres off, as fits to photographs are; all cameras move one hand."""
    shifts = np.random.default_rng(0).normal(0, 0.004, (2, 3))
    trained = [one for one in read.pictures if not one.is_held_out]
    pictures = [moved_by(one, shifts[one.moment]) for one in trained[::2]]
    base = middle_person().with_offset(read.offset_m)
    lights = PictureIlluminations({0: light_of(lit_pixels(base, pictures[:3]))})
    moved = refitted(base, pictures, lights).pictures
    for moment, shift in enumerate(shifts):
        (pose,) = {id(one.pose): one.pose for one in moved if one.moment == moment}.values()
        before = next(one.pose for one in read.pictures if one.moment == moment)
        off = (posed_vertices(hand, pose) - posed_vertices(hand, before))[hand.framed_vertices].mean(0)
        across = slice(1, 3)  # fingers point along -X, and masks tell least along them
        assert np.linalg.norm(off[across]) < 0.5 * np.linalg.norm(shift[across])
    assert overlap(hand, moved) > overlap(hand, pictures)


def light_of(pixels):
    return Illumination.of(fitted_light(pixels, np.ones_like(pixels.shown)), pixels.sources)


def test_a_left_hands_capture_is_the_mirror_image(truth, hand, folder, read, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    capture = load_capture(folder)
    mirror = np.diag([-1.0, 1, 1, 1])
    views = []
    for view in capture.views:
        path, mask = tmp_path / "left" / view.file, tmp_path / "left" / view.mask
        for file, start in ((path, folder / view.file), (mask, folder / view.mask)):
            file.parent.mkdir(parents=True, exist_ok=True)
            Image.fromarray(np.asarray(Image.open(start))[:, ::-1]).save(file, quality=97, subsampling=0)
        K = view.camera.K.copy()
        K[0, 2] = view.camera.size_px[0] - K[0, 2]
        camera = replace(view.camera, K=K, cam2world=mirror @ view.camera.cam2world @ mirror)
        views.append(replace(view, camera=camera))
    poses = tuple(pose.mirrored() for pose in capture.poses)
    save_capture_index(replace(capture, folder=tmp_path / "left", views=tuple(views), poses=poses))
    left = pictures_of_capture(tmp_path / "left", hand, 40, truth.twin.model.for_side("left"), lambda line: None)
    assert (left.side, read.side) == ("left", "right")
    for one, other in zip(left.pictures, read.pictures, strict=True):
        np.testing.assert_allclose(one.pose.theta, other.pose.theta, atol=1e-6)
        np.testing.assert_allclose(one.camera.cam2world, other.camera.cam2world, atol=1e-9)
        assert np.abs(one.rgb.astype(int) - other.rgb).mean() < 3


def test_what_is_missing_is_said(truth, hand, folder, tmp_path):
    with pytest.raises(LiveHandError, match="give its hand model with --hand"):
        pictures_of_capture(folder, hand, 40, None, lambda line: None)
    with pytest.raises(LiveHandError, match="byte for byte"):
        pictures_of_capture(folder, hand, 40, replace(truth.twin.model, sha256="0" * 64), lambda line: None)
    with pytest.raises(LiveHandError, match="--hand is the hand model of a capture's poses"):
        pictured_hand(PictureSource(tmp_path, other=truth.twin.model), hand, lambda line: None)
    with pytest.raises(LiveHandError, match="--fov is of a film or of photographs"):
        pictured_hand(PictureSource(folder, fov_deg=60.0), hand, lambda line: None)


def test_grey_pictures_are_left_out(truth, hand, folder, tmp_path):
    capture = load_capture(folder)
    grey = tmp_path / "grey"
    for view in capture.views:
        (grey / view.file).parent.mkdir(parents=True, exist_ok=True)
        (grey / view.mask).parent.mkdir(parents=True, exist_ok=True)
        image = Image.open(folder / view.file)
        (image.convert("L").convert("RGB") if view.camera_index in (1, 3) else image).save(grey / view.file)
        Image.open(folder / view.mask).save(grey / view.mask)
    same = replace(capture, folder=grey, hand_sha256=hand.sha256)
    save_capture_index(same)
    read = pictures_of_capture(grey, hand, 40, None, lambda line: None)
    assert {one.camera_index for one in read.pictures} == {0, 2, 4, 5}
    assert read.notes == ("6 grey pictures are left out",)


def test_views_are_of_few_poses_from_several_cameras(truth, folder):
    views = load_capture(folder).of_split("train")
    chosen = chosen_views(views, 6)
    assert len(chosen) == 6
    assert {view.pose_index for view in chosen} == {0}
    many = [replace(view, pose_index=10 * step + view.pose_index) for step in range(10) for view in views]
    chosen = chosen_views(many, 40)
    assert len(chosen) == 40
    assert len({view.pose_index for view in chosen}) == 8
    assert {view.camera_index for view in chosen} == set(range(6))


def test_relative_gains_go_through_chains_and_past_shine():
    rng = np.random.default_rng(1)
    gains, spots = rng.normal(0, 0.2, (5, 3)), rng.normal(-1, 0.4, (300, 3))
    values = gains[:, None] + spots + rng.normal(0, 0.02, (5, 300, 3))
    for camera in range(5):  # each sees a part that only its neighbours see, too
        values[camera, : 50 * camera] = values[camera, 50 * camera + 100 :] = np.nan
    values[2, 110:125] += 1.5
    np.testing.assert_allclose(relative_gains(values), gains - gains.mean(0), atol=0.03)
    assert not relative_gains(values[:1]).any()
