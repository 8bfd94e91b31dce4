"""Measuring an avatar: against pictures it made itself, splits, contact sheets and figures on disk."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatar import AvatarConfig, load_avatar, new_avatar, save_avatar
from livehand.backend.capture import save_capture_index
from livehand.backend.cli import COMMANDS
from livehand.backend.command import run_commands
from livehand.backend.errors import LiveHandError
from livehand.backend.evaluation.contact_sheet import GROUND, comparison_sheet, on_ground, save_sheet, tile
from livehand.backend.evaluation.evaluate import encoded_on_black, score_views, summary
from livehand.backend.field.field import FieldConfig
from livehand.backend.hand.lbs import SkinTensors, pose_hand, posed_vertices
from livehand.backend.hand.model import load_default_hand
from livehand.backend.renderer import Renderer
from livehand.backend.sampler import SamplerConfig
from livehand.backend.shot import Frame, Shot
from livehand.backend.superres import SuperResConfig
from PIL import Image

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)


@pytest.fixture(scope="module")
def hand():
    return load_default_hand()


@pytest.fixture(scope="module")
def renderer(hand):
    return Renderer(new_avatar("mine", hand.name, hand.sha256, SMALL), hand, "cpu")


@pytest.fixture(scope="module")
def own_capture(painted_capture, renderer, hand, tmp_path_factory):
    """The painted capture's views, pictured by the avatar itself."""
    folder = tmp_path_factory.mktemp("own")
    capture = replace(painted_capture, folder=folder)
    save_capture_index(capture)
    for view in capture.views:
        pose = capture.poses[view.pose_index]
        image = encoded_on_black(renderer.render(Shot(pose, posed_vertices(hand, pose), view.camera)))
        straight = np.concatenate([image[..., :3] / np.maximum(image[..., 3:], 1e-6), image[..., 3:]], -1)
        Image.fromarray((straight.clip(0, 1) * 255).round().astype(np.uint8)).save(folder / view.file)
    return capture


def test_an_avatar_is_nearly_perfect_on_its_own_pictures(renderer, own_capture):
    scores = score_views(renderer, own_capture, own_capture.views)
    assert len(scores) == 8
    for score in scores:
        assert score.psnr_full > 45
        assert score.psnr_hand > 45
        assert score.ssim > 0.999
        assert score.alpha_iou > 0.99


def test_and_worse_on_others(renderer, painted_capture, own_capture):
    others, own = (
        summary(score_views(renderer, capture, capture.of_split("test"))) for capture in (painted_capture, own_capture)
    )
    assert others["images"] == own["images"] == 2
    assert others["psnr_hand"] < 20
    assert others["psnr_full"] < 30
    assert 0.5 < others["alpha_iou"] < own["alpha_iou"]


def test_a_score_names_its_view_and_keeps_its_pictures(renderer, own_capture):
    view = own_capture.of_split("test")[1]
    (score,) = score_views(renderer, own_capture, [view])
    assert (score.file, score.split) == (view.file, "test")
    np.testing.assert_array_equal(score.truth, own_capture.read_image(view))
    assert score.image.shape == score.truth.shape


def test_views_without_the_hand_are_left_out_and_none_is_an_error(renderer, own_capture, tmp_path):
    view = own_capture.views[0]
    empty = replace(view, file=str(tmp_path / "empty.png"))
    Image.new("RGBA", view.camera.size_px).save(tmp_path / "empty.png")
    assert len(score_views(renderer, own_capture, [view, empty])) == 1
    for views in ([empty], []):
        with pytest.raises(LiveHandError, match="must have views of the asked split"):
            score_views(renderer, own_capture, views)
    with pytest.raises(LiveHandError, match="another hand"):
        score_views(renderer, replace(own_capture, hand_sha256="0" * 64), [view])


def test_means_are_means(renderer, own_capture):
    scores = score_views(renderer, own_capture, own_capture.of_split("test"))
    figures = summary([replace(scores[0], psnr_full=10.0, ssim=0.5), replace(scores[1], psnr_full=20.0, ssim=0.25)])
    assert (figures["images"], figures["psnr_full"], figures["ssim"]) == (2, 15.0, 0.375)


def test_frames_are_encoded_on_black():
    half_linear = ((0.5 + 0.055) / 1.055) ** 2.4
    alpha = np.array([[0.5, 0.0, 1.0]], np.float32)
    rgb = np.array([[[half_linear * 0.5] * 3, [0] * 3, [2.0, half_linear, 0]]], np.float32)
    image = encoded_on_black(Frame(rgb, alpha, np.zeros((1, 3), np.float32)))
    np.testing.assert_allclose(image, [[[0.25] * 3 + [0.5], [0] * 4, [1, 0.5, 0, 1]]], atol=1e-6)


@pytest.mark.parametrize("side", ["right", "left"])
def test_vertices_are_the_skins(hand, own_capture, side):
    pose = replace(own_capture.poses[0], side=side)
    skin = SkinTensors.of(hand.for_side(side), dtype=torch.float64)
    expected = pose_hand(skin, *(torch.as_tensor(v) for v in (pose.theta, pose.beta, pose.transl))).vertices
    np.testing.assert_allclose(posed_vertices(hand, pose), expected)


def test_tiles_lie_row_by_row():
    tiles = [np.full((2, 3, 3), value) for value in (0.0, 0.2, 0.4, 1.5)]
    sheet = tile(tiles, 3)
    assert sheet.shape == (4, 9, 3)
    assert sheet.dtype == np.uint8
    np.testing.assert_array_equal(sheet[0, ::3, 0], [0, 51, 102])
    np.testing.assert_array_equal(sheet[3, ::3, 0], [255, 0, 0])


def test_a_sheet_shows_truth_image_and_error(tmp_path):
    truth = np.zeros((2, 2, 4), np.float32)
    image = np.zeros((2, 2, 4), np.float32)
    image[..., :3], image[..., 3] = 0.1, 1.0
    sheet = comparison_sheet([(truth, image)] * 5, triples_per_row=4)
    assert sheet.shape == (4, 24, 3)
    np.testing.assert_array_equal(sheet[0, [0, 2, 4], 0], [round(GROUND * 255), 26, 102])
    np.testing.assert_allclose(on_ground(truth), GROUND)
    np.testing.assert_allclose(on_ground(image), 0.1)
    save_sheet(sheet, tmp_path / "new" / "sheet.png")
    with Image.open(tmp_path / "new" / "sheet.png") as stored:
        np.testing.assert_array_equal(np.asarray(stored), sheet)


@pytest.fixture
def avatar_path(renderer, tmp_path):
    save_avatar(renderer.avatar, tmp_path / "mine.safetensors")
    return tmp_path / "mine.safetensors"


def evaluate(*arguments):
    return run_commands("livehand", "", COMMANDS, ["evaluate", *map(str, arguments)])


def test_the_command_writes_figures_and_a_sheet(own_capture, avatar_path, tmp_path, capsys):
    out = tmp_path / "figures"
    arguments = (own_capture.folder, "--avatar", avatar_path, "-o", out, "--device", "cpu")
    assert evaluate(*arguments, "--json") == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["images"] == 2
    assert figures["psnr_full"] > 40  # weights went through half precision
    with Image.open(out / "contact_sheet.png") as sheet:
        assert sheet.size == (12 * 24, 32)
    with (out / "scores.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["file"] for row in rows] == [view.file for view in own_capture.of_split("test")]
    assert np.mean([float(row["psnr_full"]) for row in rows]) == pytest.approx(figures["psnr_full"], abs=1e-3)


def test_recorded_figures_lie_in_the_header_and_nothing_else_changes(own_capture, avatar_path, capsys):
    before = load_avatar(avatar_path)
    assert evaluate(own_capture.folder, "--avatar", avatar_path, "--device", "cpu", "--json", "--record") == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    after = load_avatar(avatar_path)
    assert after.metrics == {**before.metrics, "test": figures}
    assert after.provenance == before.provenance
    for name, weights in before.superres.state_dict().items():
        assert after.superres.state_dict()[name].equal(weights)


def test_the_command_knows_splits(own_capture, avatar_path, capsys):
    arguments = (own_capture.folder, "--avatar", avatar_path, "--device", "cpu")
    assert evaluate(*arguments, "--split", "all") == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines] == [["test", "2"], ["train", "6"], ["all", "8"]]
    assert evaluate(*arguments, "--split", "train", "--json") == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["images"] == 6


def test_the_command_tells_bad_input(own_capture, avatar_path, tmp_path, capsys):
    assert evaluate(tmp_path, "--avatar", avatar_path) == 1
    assert "transforms.json" in capsys.readouterr().err
    assert evaluate(own_capture.folder, "--avatar", tmp_path / "gone.safetensors") == 1
    assert "no avatar at" in capsys.readouterr().err
    assert evaluate(own_capture.folder, "--split", "best") == 2
