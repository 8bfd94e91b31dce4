"""A capture that would spoil a training is refused at the start, every fault with its file's name."""

import shutil
from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.capture.capture import load_capture, save_capture_index
from livehand.backend.capture.check import check_capture, hand_box
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.records.errors import LiveHandError
from PIL import Image


@pytest.fixture
def capture(painted_capture, tmp_path):
    folder = tmp_path / "capture"
    shutil.copytree(painted_capture.folder, folder)
    return load_capture(folder)


def with_view(capture, index=1, **changes):
    views = list(capture.views)
    views[index] = replace(views[index], **changes)
    return replace(capture, views=tuple(views))


def with_camera(capture, **changes):
    return with_view(capture, camera=replace(capture.views[1].camera, **changes))


@pytest.mark.slow
def test_a_sound_capture_passes(capture, hand):
    check_capture(capture, hand)
    check_capture(capture, hand, decode=False)


def test_masks_stand_in_for_alpha(capture, hand):
    path = capture.folder / capture.views[1].file
    alpha = Image.open(path).getchannel("A")
    Image.open(path).convert("RGB").save(path)
    with pytest.raises(LiveHandError, match=r"0_1\.png must have alpha \(RGBA\) or a mask, got mode RGB"):
        check_capture(capture, hand)
    alpha.save(capture.folder / "mask.png")
    masked = with_view(capture, mask="mask.png")
    check_capture(masked, hand)
    Image.new("I;16", alpha.size, 300).save(capture.folder / "mask.png")
    with pytest.raises(LiveHandError, match=r"mask\.png must be a mask of 8 bits per channel, got mode I"):
        check_capture(masked, hand)
    Image.new("L", (3, 4)).save(capture.folder / "mask.png")
    with pytest.raises(LiveHandError, match=r"mask\.png must be \(24, 32\) px like its camera, got \(3, 4\)"):
        check_capture(masked, hand)
    Image.new("L", alpha.size).save(capture.folder / "mask.png")
    with pytest.raises(LiveHandError, match=r"mask\.png must show the hand"):
        check_capture(masked, hand)
    (capture.folder / "mask.png").unlink()
    with pytest.raises(LiveHandError, match=r"mask\.png must be a readable image"):
        check_capture(masked, hand)


K = np.array([[76.8, 0, 12], [0, 76.8, 16], [0, 0, 1]])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (
            lambda c: replace(c, hand_sha256="0" * 64),
            "it must be of hand 'hand_with.*_arm', got one of hand 000000000000",
        ),
        (lambda c: replace(c, views=()), "it must have images, got none"),
        (lambda c: with_view(c, file="0_0.png"), r"0_0\.png must be named once, got 2 times"),
        (lambda c: with_view(c, camera_index=0), "camera 0 must have one image of pose 0, got 2"),
        (
            lambda c: replace(c, poses=(c.poses[0], replace(c.poses[1], side="left"))),
            "pose 1 must be of the right hand",
        ),
        (lambda c: with_camera(c, K=K * [[-1], [1], [1]]), r"0_1\.png: K must be .*fx and fy above 0"),
        (lambda c: with_camera(c, K=K.T), r"0_1\.png: K must be"),
        (lambda c: with_camera(c, cam2world=c.views[1].camera.cam2world.T), r"0_1\.png: the last row .*transposed"),
    ],
)
def test_faults_of_the_index_are_named(capture, hand, spoil, message):
    with pytest.raises(LiveHandError, match=message):
        check_capture(spoil(capture), hand)


def spoil_image(capture, kind):
    path = capture.folder / capture.views[1].file
    data = path.read_bytes()
    size = capture.views[1].camera.size_px
    rows, columns = np.mgrid[: size[1], : size[0]]
    corner = np.where((rows > size[1] - 3) & (columns > size[0] - 3), 255, 0).astype(np.uint8)
    {
        "missing": path.unlink,
        "text": lambda: path.write_text("no picture"),
        "cut": lambda: path.write_bytes(data[: len(data) * 2 // 3]),
        "size": lambda: Image.new("RGBA", (size[0] + 1, size[1])).save(path),
        "empty": lambda: Image.new("RGBA", size, (9, 9, 9, 0)).save(path),
        "elsewhere": lambda: Image.fromarray(np.dstack([corner] * 4)).save(path),
    }[kind]()


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("missing", r"0_1\.png must be a readable image .*No such file"),
        ("text", r"0_1\.png must be a readable image"),
        ("cut", r"0_1\.png must be a readable image .*truncated"),
        ("size", r"0_1\.png must be \(24, 32\) px like its camera, got \(25, 32\)"),
        ("empty", r"0_1\.png must show the hand, which its pose and camera put in the image, got alpha 0"),
        (
            "elsewhere",
            r"0_1\.png must show the hand where its pose and camera put it, .* got \(22, 30\) to \(24, 32\) px",
        ),
    ],
)
def test_faults_of_images_are_named(capture, hand, kind, message):
    spoil_image(capture, kind)
    with pytest.raises(LiveHandError, match=message):
        check_capture(capture, hand)


def test_headers_alone_are_looked_at_where_pixels_are_not_asked_for(capture, hand):
    spoil_image(capture, "empty")
    check_capture(capture, hand, decode=False)
    for kind, message in (("size", r"must be \(24, 32\) px like its camera"), ("missing", "readable")):
        spoil_image(capture, kind)
        with pytest.raises(LiveHandError, match=message):
            check_capture(capture, hand, decode=False)


def test_an_empty_image_of_a_hand_out_of_view_is_no_fault(capture, hand):
    spoil_image(capture, "empty")
    away = capture.views[1].camera.cam2world @ np.diag([1.0, -1, -1, 1])
    check_capture(with_camera(capture, cam2world=away), hand)


def test_cameras_that_all_look_away_are_no_capture(capture, hand):
    """As with OpenGL's axes taken for OpenCV's."""
    away = np.diag([1.0, -1, -1, 1])
    views = [replace(v, camera=replace(v.camera, cam2world=v.camera.cam2world @ away)) for v in capture.views]
    with pytest.raises(LiveHandError, match="no camera sees the hand; cam2world must have OpenCV's axes"):
        check_capture(replace(capture, views=tuple(views)), hand)


def test_all_faults_are_counted_and_ten_shown(capture, hand):
    for view in capture.views[:3]:
        (capture.folder / view.file).unlink()
    with pytest.raises(LiveHandError, match="has 3 faults:") as caught:
        check_capture(capture, hand)
    assert len(str(caught.value).splitlines()) == 4
    many = LiveHandError.of_faults("it", [f"fault {k}" for k in range(14)])
    assert str(many).splitlines() == ["it has 14 faults:", *(f"  fault {k}" for k in range(10)), "  and 4 more"]
    assert str(LiveHandError.of_faults("it", ["fault"])) == "it: fault"


def test_the_index_tells_all_its_faults_at_once(capture):
    document = (capture.folder / "transforms.json").read_text()
    spoilt = document.replace('"pose_index": 1', '"pose_index": 7')
    (capture.folder / "transforms.json").write_text(spoilt)
    with pytest.raises(LiveHandError, match=r"has 4 faults:(?s:.*)1_3\.png must name one of 2 poses, got 7"):
        load_capture(capture.folder)
    (capture.folder / "transforms.json").write_text(document)
    with np.load(capture.folder / "poses.npz") as archive:
        arrays = dict(archive)
    arrays["theta"][:, 3, 1] = np.nan
    np.savez(capture.folder / "poses.npz", **arrays)
    with pytest.raises(LiveHandError, match=r"poses\.npz has 2 faults:(?s:.*)pose 1: theta must be finite"):
        load_capture(capture.folder)


def test_masks_survive_the_index(capture):
    masked = with_view(capture, mask="masks/a.png")
    save_capture_index(masked)
    assert [view.mask for view in load_capture(capture.folder).views[:3]] == [None, "masks/a.png", None]
    text = (capture.folder / "transforms.json").read_text()
    (capture.folder / "transforms.json").write_text(text.replace('"masks/a.png"', "3"))
    with pytest.raises(LiveHandError, match=r"0_1\.png: mask_path must be a file's name, got 3"):
        load_capture(capture.folder)


def test_the_box_is_of_the_vertices_in_the_image(capture, hand):
    view = capture.views[0]
    vertices = posed_vertices(hand, capture.poses[0])
    pixels, _ = view.camera.project(vertices)
    inside = pixels[((pixels >= 0) & (pixels < view.camera.size_px)).all(1)]
    np.testing.assert_allclose(hand_box(vertices, view.camera), [inside.min(0), inside.max(0)])
    assert hand_box(vertices + np.array([0, 0, 0.3]), view.camera) is None
