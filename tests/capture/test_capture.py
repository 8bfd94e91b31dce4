"""Capture folders: there and back, and every fault named with its file."""

import json
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.capture import Capture, CaptureView, load_capture, save_capture_index
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from PIL import Image

SIZE = (6, 9)


def a_capture(folder):
    rng = np.random.default_rng(0)
    poses = tuple(
        HandPose(rng.normal(size=(16, 3)), rng.normal(size=10), rng.normal(size=3), side) for side in ("right", "left")
    )
    views = []
    for index, split in enumerate(("train", "train", "novel_pose", "test")):
        cam2world = look_at(rng.normal(size=3), np.zeros(3), np.array([0, 0, 1.0]))
        camera = Camera(np.array([[50.3, 0, 3.1], [0, 49.7, 4.4], [0, 0, 1]]), cam2world, SIZE)
        views.append(CaptureView(f"images/{index}.png", camera, index % 2, index // 2, split))
    return Capture(folder, "ab" * 32, {"made_by": "test"}, poses, tuple(views))


@pytest.fixture
def capture(tmp_path):
    made = a_capture(tmp_path)
    save_capture_index(made)
    (tmp_path / "images").mkdir()
    pixels = np.random.default_rng(1).integers(0, 256, (SIZE[1], SIZE[0], 4), np.uint8)
    for view in made.views:
        Image.fromarray(pixels).save(tmp_path / view.file)
    return made


def test_round_trip_is_exact(capture):
    back = load_capture(str(capture.folder))
    assert (back.hand_sha256, back.provenance) == (capture.hand_sha256, capture.provenance)
    for one, other in zip(back.poses, capture.poses, strict=True):
        assert one.side == other.side
        for name in ("theta", "beta", "transl"):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for one, other in zip(back.views, capture.views, strict=True):
        assert (one.file, one.split, one.camera_index, one.pose_index, one.camera.size_px) == (
            other.file,
            other.split,
            other.camera_index,
            other.pose_index,
            other.camera.size_px,
        )
        np.testing.assert_array_equal(one.camera.K, other.camera.K)
        np.testing.assert_array_equal(one.camera.cam2world, other.camera.cam2world)


def test_turned_forearms_are_kept_and_may_be_missing(capture):
    """Files without any read as straight ones, and straight ones are written as before."""
    with np.load(capture.folder / "poses.npz") as arrays:
        assert "forearm" not in arrays
    assert not any(pose.forearm.any() for pose in load_capture(capture.folder).poses)
    turned = tuple(replace(pose, forearm=np.array([0.1, -0.2, 0.7 + k])) for k, pose in enumerate(capture.poses))
    save_capture_index(replace(capture, poses=turned))
    for one, other in zip(load_capture(capture.folder).poses, turned, strict=True):
        np.testing.assert_array_equal(one.forearm, other.forearm)


@pytest.mark.parametrize("forearm", [np.zeros((1, 3)), np.zeros((2, 4)), np.full((2, 3), np.nan)])
def test_malformed_forearms_are_named(capture, forearm):
    with np.load(capture.folder / "poses.npz") as arrays:
        np.savez(capture.folder / "poses.npz", **{**arrays, "forearm": forearm})
    with pytest.raises(LiveHandError, match="forearm"):
        load_capture(capture.folder)


def test_splits_keep_their_order(capture):
    assert [view.file for view in capture.of_split("train")] == ["images/0.png", "images/1.png"]
    assert capture.of_split("novel_camera") == ()


def test_images_are_put_on_black(capture):
    view = capture.views[0]
    stored = np.asarray(Image.open(capture.folder / view.file), np.float32) / 255
    image = capture.read_image(view)
    assert image.dtype == np.float32
    np.testing.assert_allclose(image[..., 3], stored[..., 3])
    np.testing.assert_allclose(image[..., :3], stored[..., :3] * stored[..., 3:], atol=1e-7)


def test_bad_images_are_named(capture):
    view = capture.views[1]
    path = capture.folder / view.file
    Image.new("RGBA", (SIZE[0], SIZE[1] + 1)).save(path)
    with pytest.raises(LiveHandError, match=r"images/1\.png must be \(6, 9\) px like its camera, got \(6, 10\)"):
        capture.read_image(view)
    Image.new("RGB", SIZE).save(path)
    with pytest.raises(LiveHandError, match=r"images/1\.png must have alpha"):
        capture.read_image(view)
    data = (capture.folder / "images/0.png").read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(LiveHandError, match=r"images/1\.png must be a readable image"):
        capture.read_image(view)
    path.unlink()
    with pytest.raises(LiveHandError, match=r"images/1\.png must be a readable image"):
        capture.read_image(view)


def spoilt(capture, change):
    path = capture.folder / "transforms.json"
    document = json.loads(path.read_text())
    change(document)
    path.write_text(json.dumps(document))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            lambda d: d.update(format="nerf"),
            r"transforms\.json must say format livehand-capture version 1 or 2, got 'nerf'",
        ),
        (lambda d: d.update(version=3), r"transforms\.json must say format"),
        (lambda d: d["frames"][2].pop("K"), r"images/2\.png must have a 'K'"),
        (lambda d: d["frames"][2].pop("file_path"), "every frame in transforms.json must have a file_path"),
        (lambda d: d["frames"][2].update(K=[[1, 2], [3, 4]]), r"images/2\.png: K must be \[3, 3\]"),
        (lambda d: d["frames"][2].update(K="wide"), r"images/2\.png: "),
        (lambda d: d["frames"][2].update(cam2world=np.diag([2.0, 2, 2, 1]).tolist()), r"images/2\.png: .*rotation"),
        (lambda d: d["frames"][2].update(size_px=[6]), r"images/2\.png: "),
        (lambda d: d["frames"][2].update(pose_index=2), r"images/2\.png must name one of 2 poses, got 2"),
        (lambda d: d["frames"][2].update(pose_index=-1), "must name one of 2 poses, got -1"),
        (lambda d: d["frames"][2].update(split="val"), r"images/2\.png: split must be one of .*got 'val'"),
    ],
)
def test_faults_of_the_index_are_named(capture, change, message):
    spoilt(capture, change)
    with pytest.raises(LiveHandError, match=message):
        load_capture(capture.folder)


@pytest.mark.parametrize(
    "change",
    [
        lambda d: d.pop("frames"),
        lambda d: d.pop("hand_sha256"),
        lambda d: d.update(frames={"0": {}}),
        lambda d: d.update(frames=[None]),
        lambda d: d["frames"][0].update(camera_index="first"),
        lambda d: d["frames"][0].update(camera_index=None),
        lambda d: d["frames"][0].update(size_px=None),
    ],
)
def test_other_malformed_indices_are_errors_of_ours(capture, change):
    spoilt(capture, change)
    with pytest.raises(LiveHandError):
        load_capture(capture.folder)


@pytest.mark.parametrize("text", ["", "{", "[1, 2]", '"text"', "\x00\xff"])
def test_an_index_that_is_no_index_is_named(capture, text):
    (capture.folder / "transforms.json").write_text(text, encoding="latin-1")
    with pytest.raises(LiveHandError, match=r"transforms\.json"):
        load_capture(capture.folder)


def test_missing_files_are_named(capture):
    (capture.folder / "poses.npz").unlink()
    with pytest.raises(LiveHandError, match=r"poses\.npz"):
        load_capture(capture.folder)
    with pytest.raises(LiveHandError, match=r"nowhere/transforms\.json must be a capture's index"):
        load_capture(capture.folder / "nowhere")


@pytest.mark.parametrize(
    "change",
    [
        lambda a: a.pop("theta"),
        lambda a: a.update(theta=a["theta"][:, :15]),
        lambda a: a.update(beta=a["beta"][:1]),
        lambda a: a.update(transl=a["transl"] * np.nan),
        lambda a: a.update(side=np.array(["right", "up"])),
        lambda a: a.update(theta=np.array([{}, {}], dtype=object)),
    ],
)
def test_faults_of_the_poses_are_named(capture, change):
    path = capture.folder / "poses.npz"
    with np.load(path) as archive:
        arrays = dict(archive)
    change(arrays)
    np.savez(path, **arrays)
    with pytest.raises(LiveHandError, match=r"poses\.npz"):
        load_capture(capture.folder)


def test_poses_that_are_cut_short_are_named(capture):
    path = capture.folder / "poses.npz"
    data = path.read_bytes()
    for size in (0, 10, len(data) // 2, len(data) - 10):
        path.write_bytes(data[:size])
        with pytest.raises(LiveHandError, match=r"poses\.npz"):
            load_capture(capture.folder)


def test_masks_lie_in_the_captures_folder(painted_capture, tmp_path):
    """`livehand mask` writes where a mask's name leads."""
    for name in ("transforms.json", "poses.npz"):
        (tmp_path / name).write_bytes((painted_capture.folder / name).read_bytes())
    document = json.loads((tmp_path / "transforms.json").read_text())
    for name in ("../out.png", "/tmp/out.png"):
        document["frames"][2]["mask_path"] = name
        (tmp_path / "transforms.json").write_text(json.dumps(document))
        with pytest.raises(LiveHandError, match="a path that leads out of it"):
            load_capture(tmp_path)
