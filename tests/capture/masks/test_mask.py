"""Masks of photographed hands: found where the fit is off, cut at the wrist, written beside the images."""

import json
import sys
from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.capture.capture import Capture, CaptureView, load_capture, save_capture_index
from livehand.backend.capture.exr import write_exr
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.capture.masks.mask import MaskConfig, grabcut_mask, hand_regions
from livehand.backend.capture.masks.mask_capture import mask_capture
from livehand.backend.capture.picture import linear_to_srgb, srgb_to_linear
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Light
from livehand.backend.records.shot import HandPose
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS
from livehand.tools.builtin_hand import TEMPLATE
from PIL import Image

pytestmark = pytest.mark.slow

SIZE = (72, 96)
CONFIG = MaskConfig()


@pytest.fixture(scope="session")
def hand(hand_without_arm):
    """A mesh that ends at the wrist, where a photograph goes on."""
    return hand_without_arm


@pytest.fixture(scope="module")
def camera(hand):
    focal_px = 96 * 0.6 / 0.3
    K = np.array([[focal_px, 0, 36], [0, 1.1 * focal_px, 40], [0, 0, 1]])
    return Camera(K, look_at(hand.joints[4] + [0.02, 0.6, 0.03], hand.joints[4], np.array([-1.0, 0, 0])), SIZE)


def drawn(hand, camera, pose):
    vertices, _ = posed_arrays(hand, pose)
    positions_px, depth = (torch.as_tensor(values) for values in camera.project(vertices))
    mask = np.zeros(SIZE[0] * SIZE[1], bool)
    mask[rasterise(positions_px, depth, torch.as_tensor(hand.f), SIZE).pixel.numpy()] = True
    return mask.reshape(SIZE[::-1])


def photograph(mask, seed=0):
    """Skin on a dark, uneven, noisy ground."""
    rng = np.random.default_rng(seed)
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    ground = np.stack([40 + rows / 4, 70 + columns / 5, 60 + 15 * np.sin(rows / 9)], -1)
    skin = np.array([205, 150, 125]) + 20 * np.sin(columns / 7)[..., None]
    return (np.where(mask[..., None], skin, ground) + rng.normal(0, 5, (*mask.shape, 3))).clip(0, 255).astype(np.uint8)


def regions_of(hand, camera, pose, config=CONFIG):
    return hand_regions(*posed_arrays(hand, pose), hand.f, camera, config)


def iou(a, b):
    return (a & b).sum() / (a | b).sum()


def test_the_hand_is_found_where_the_fit_is_millimetres_off(hand, camera):
    truth = drawn(hand, camera, HandPose.rest())
    fit = replace(HandPose.rest(), transl=np.array([0.001, 0, 0.004]))
    regions = regions_of(hand, camera, fit)
    mask = grabcut_mask(photograph(truth), regions, CONFIG)
    assert iou(regions.silhouette, truth) < 0.85
    assert iou(mask, truth) > 0.97
    np.testing.assert_array_equal(grabcut_mask(photograph(truth), regions, CONFIG), mask)


def test_the_forearm_is_cut_at_the_meshs_end(hand, camera):
    """A cylinder of skin from the mesh's end to a sleeve."""
    truth = drawn(hand, camera, HandPose.rest())
    last = np.flatnonzero(truth.any(1))[-1]
    columns = np.flatnonzero(truth[last - 2])
    forearm = np.zeros_like(truth)
    forearm[last + 1 : last + 9, columns[0] : columns[-1] + 1] = True
    config = replace(CONFIG, dilate_mm=30.0)
    regions = regions_of(hand, camera, HandPose.rest(), config)
    mask = grabcut_mask(photograph(truth | forearm), regions, config)
    assert forearm.sum() > 100
    assert (regions.forearm & forearm).sum() > 0.8 * forearm.sum()
    assert iou(mask, truth) > 0.97
    assert not (mask & forearm)[last + 3 :].any()


def test_only_the_largest_part_is_kept(hand, camera):
    truth = drawn(hand, camera, HandPose.rest())
    regions = regions_of(hand, camera, HandPose.rest())
    rows, columns = np.nonzero(regions.near & ~regions.silhouette & ~regions.forearm)
    spot = np.zeros_like(truth)
    spot[rows[0] : rows[0] + 2, columns[0] : columns[0] + 2] = True  # a far corner of what may be hand
    mask = grabcut_mask(photograph(truth | spot), regions, CONFIG)
    assert not mask[spot].any()


def test_distances_are_millimetres_along_both_axes(hand, camera):
    flat = replace(camera, K=np.array([[192.0, 0, 36], [0, 100, 40], [0, 0, 1]]))
    regions = regions_of(hand, flat, HandPose.rest(), replace(CONFIG, dilate_mm=20.0))
    depth_m = np.median(flat.project(posed_arrays(hand, HandPose.rest())[0])[1])
    for axis, focal_px in ((0, 192), (1, 100)):
        near, inner = (np.flatnonzero(region.any(axis)) for region in (regions.near, regions.silhouette))
        assert inner[0] - near[0] == round(0.020 * focal_px / depth_m)
    assert (regions.core & ~regions.silhouette).sum() == 0
    assert 0 < regions.core.sum() < regions.silhouette.sum() < regions.near.sum()


def test_a_hand_out_of_view_has_no_mask_and_one_that_fills_it_has_no_ground(hand, camera):
    away = replace(HandPose.rest(), transl=np.array([0.0, 0, 9.0]))
    nothing = np.zeros(SIZE[::-1], bool)
    assert not grabcut_mask(photograph(nothing), regions_of(hand, camera, away), CONFIG).any()
    close = replace(camera, K=np.diag([60.0, 60, 1]) @ camera.K)
    close = replace(close, K=np.array([[2e4, 0, 36], [0, 2e4, 48], [0, 0, 1.0]]))
    regions = regions_of(hand, close, HandPose.rest())
    assert regions.silhouette.all()
    assert grabcut_mask(photograph(~nothing), regions, CONFIG).all()


@pytest.fixture
def capture(hand, camera, tmp_path):
    """Two photographs without alpha, one with, all of the hand where its poses say."""
    poses = tuple(replace(HandPose.rest(), transl=np.array([0, 0, z])) for z in (0.0, 0.01, 0.02))
    names = ("images/a/0.jpg", "images/a/1.png", "images/2.png")
    views = tuple(CaptureView(name, camera, 0, index, "train") for index, name in enumerate(names))
    made = Capture(tmp_path, hand.sha256, {}, poses, views)
    save_capture_index(made)
    (tmp_path / "images/a").mkdir(parents=True)
    for view, pose in zip(views, poses, strict=True):
        truth = drawn(hand, camera, pose)
        pixels = photograph(truth)
        if view.file == "images/2.png":
            pixels = np.concatenate([pixels, truth[..., None].astype(np.uint8) * 255], -1)
        Image.fromarray(pixels).save(tmp_path / view.file, quality=95)
    return made


def test_a_capture_is_given_the_masks_it_lacks(hand, camera, capture):
    masked = mask_capture(capture.folder, hand, CONFIG)
    assert [view.view.mask for view in masked] == ["masks/images/a/0.png", "masks/images/a/1.png"]
    back = load_capture(capture.folder)
    assert [view.mask for view in back.views] == ["masks/images/a/0.png", "masks/images/a/1.png", None]
    for view, made in zip(back.views[:2], masked, strict=True):
        truth = drawn(hand, camera, capture.poses[view.pose_index])
        pixels = back.read_pixels(view)
        assert iou(pixels[..., 3] > 0, truth) > 0.97
        assert made.overlap == pytest.approx(iou(pixels[..., 3] > 0, truth))
        stored = np.asarray(Image.open(capture.folder / view.file))
        np.testing.assert_array_equal(pixels[..., :3], stored)
    assert mask_capture(capture.folder, hand, CONFIG) == []


def test_images_in_single_lights_get_the_mask_of_their_sum(hand, camera, capture):
    """Two lights, each of which reaches one half of the image; one of them is linear and has another exposure."""
    truth = drawn(hand, camera, capture.poses[0])
    linear = srgb_to_linear(photograph(truth).astype(np.float32) / 255)
    is_left = np.arange(SIZE[0])[None, :, None] < SIZE[0] / 2
    encoded = linear_to_srgb(linear * is_left)
    Image.fromarray((encoded * 255).round().astype(np.uint8)).save(capture.folder / "images/left.png")
    right = (3 * linear * ~is_left).astype(np.float16)
    write_exr(capture.folder / "images/right.exr", {name: right[..., k] for k, name in enumerate("RGB")})
    views = (
        replace(capture.views[0], file="images/left.png", light=0),
        replace(capture.views[0], file="images/right.exr", light=1, exposure=3.0),
    )
    lights = (CaptureLight("", Light()),) * 2
    save_capture_index(replace(capture, views=views, lights=lights))
    masked = mask_capture(capture.folder, hand, CONFIG)
    back = load_capture(capture.folder)
    assert [view.view.mask for view in masked] == ["masks/images/left.png", "masks/images/right.png"]
    for view in back.views:
        assert iou(back.read_linear(view)[..., 3] > 0, truth) > 0.97


def test_masks_that_are_there_are_kept_unless_all_are_made_anew(hand, capture):
    mask = capture.folder / "masks/images/a/0.png"
    mask.parent.mkdir(parents=True)
    corner = np.zeros(SIZE[::-1], np.uint8)
    corner[:4, :4] = 255
    Image.fromarray(corner).save(mask)
    assert len(mask_capture(capture.folder, hand, CONFIG)) == 2  # as after a kill: the index does not know it yet
    np.testing.assert_array_equal(Image.open(mask), corner)
    assert len(mask_capture(capture.folder, hand, CONFIG, redo=True)) == 3
    assert (np.asarray(Image.open(mask)) != corner).any()


def test_masks_can_be_given(hand, capture, tmp_path):
    given = tmp_path / "given"
    expected = {}
    for name in ("a/0.png", "images/a/1.png"):
        (given / name).parent.mkdir(parents=True, exist_ok=True)
        expected[name] = np.random.default_rng(len(name)).integers(0, 256, SIZE[::-1]).astype(np.uint8)
    Image.fromarray(expected["a/0.png"]).save(given / "a/0.png")
    alpha = np.dstack([np.zeros((*SIZE[::-1], 3), np.uint8), expected["images/a/1.png"]])
    Image.fromarray(alpha).save(given / "images/a/1.png")
    mask_capture(capture.folder, hand, CONFIG, given)
    back = load_capture(capture.folder)
    for view, mask in zip(back.views, expected.values(), strict=False):
        np.testing.assert_array_equal(back.read_pixels(view)[..., 3], mask)


@pytest.mark.parametrize("fault", ["missing", "size", "none"])
def test_faults_are_all_named_and_leave_the_index_as_it_was(hand, capture, tmp_path, fault):
    before = (capture.folder / "transforms.json").read_bytes()
    given, message = None, "has 2 faults"
    if fault == "size":
        Image.new("RGB", (3, 4)).save(capture.folder / "images/a/1.png")
        message = r"images/a/1\.png must be \(72, 96\) px like its camera, got \(3, 4\)"
    elif fault == "missing":
        given, message = tmp_path / "nowhere", r"has 2 faults(?s:.*)images/a/0\.jpg must have a mask at .*a/0\.png"
    else:
        given = tmp_path / "masks_of_others"
        (given / "a").mkdir(parents=True)
        for name in ("0", "1"):
            (given / f"a/{name}.png").write_bytes(b"")
    with pytest.raises(LiveHandError, match=message):
        mask_capture(capture.folder, hand, CONFIG, given)
    assert (capture.folder / "transforms.json").read_bytes() == before


@pytest.mark.parametrize(
    ("names", "message"),
    [(("../a.jpg", "b.jpg"), "must lie in the capture's folder"), (("a.jpg", "a.bmp"), "more than their suffix")],
)
def test_masks_stay_in_the_captures_folder_and_apart(hand, capture, names, message):
    views = tuple(replace(view, file=name) for view, name in zip(capture.views, names, strict=False))
    folder = capture.folder / "inner"
    folder.mkdir()
    save_capture_index(replace(capture, folder=folder, views=views))
    for name in names:
        Image.new("RGB", SIZE).save(folder / name)
    with pytest.raises(LiveHandError, match=message):
        mask_capture(folder, hand, CONFIG)


def test_without_opencv_it_is_told_what_to_install(hand, capture, monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(LiveHandError, match=r'install it with: pip install "livehand\[masks\]"'):
        mask_capture(capture.folder, hand, CONFIG)


def test_the_command_masks(capture, capsys):
    command = ["mask", str(capture.folder), "--hand", str(TEMPLATE), "--no-arm"]
    assert run_commands("livehand", "", COMMANDS, [*command, "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["masks"] == 2
    assert result["overlap"] > 0.97
    assert run_commands("livehand", "", COMMANDS, command) == 0
    assert "nothing to do" in capsys.readouterr().out
    assert run_commands("livehand", "", COMMANDS, ["mask", str(capture.folder)]) == 1
    assert "must be of hand" in capsys.readouterr().err
