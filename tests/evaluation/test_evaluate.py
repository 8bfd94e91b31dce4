"""Measuring an avatar: against pictures it made itself, splits, contact sheets and figures on disk."""

import csv
import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import load_avatar, save_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.capture.capture import SurfaceReference, save_capture_index
from livehand.backend.capture.exr import write_exr
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.capture.person import PERSONS
from livehand.backend.evaluation.contact_sheet import (
    BACKGROUND,
    comparison_sheet,
    label_strip,
    on_background,
    save_sheet,
    tile,
)
from livehand.backend.evaluation.distances import Distance
from livehand.backend.evaluation.evaluate import check_any, encoded_on_black, scored_views
from livehand.backend.evaluation.report import summary
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.lbs import SkinTensors, pose_hand, posed_vertices
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.frame import Frame
from livehand.backend.records.light import Lamp, Light
from livehand.backend.records.shot import Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.surface.base_surface import surface_of_person, whole_surface
from livehand.backend.surface.surface_file import surface_sha256, write_surface
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS
from livehand.tests.builders import scores_of
from PIL import Image

pytestmark = pytest.mark.slow

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)


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


def test_an_avatar_is_nearly_perfect_on_its_own_renders(renderer, own_capture):
    scores = scores_of(renderer, own_capture, own_capture.views)
    assert len(scores) == 8
    for figures in (score.figures for score in scores):
        assert figures["psnr_full"] > 45
        assert figures["psnr_hand"] > 45
        assert figures["ssim"] > 0.999
        assert figures["alpha_iou"] > 0.99
        assert sum(share for name, share in figures.items() if name.startswith("share_")) == pytest.approx(1)


def test_an_avatar_is_worse_on_other_images(renderer, painted_capture, own_capture):
    others, own = (
        summary(scores_of(renderer, capture, capture.of_split("test"))) for capture in (painted_capture, own_capture)
    )
    assert others["images"] == own["images"] == 2
    assert others["psnr_hand"] < 20
    assert others["psnr_full"] < 30
    assert 0.5 < others["alpha_iou"] < own["alpha_iou"]
    assert others["ssim_hand"] < others["ssim"] < own["ssim"]


def test_a_score_names_its_view_and_has_both_images(renderer, own_capture):
    view = own_capture.of_split("test")[1]
    (scored,) = scored_views(renderer, own_capture, [view])
    score = scored.score
    assert (score.file, score.split, score.camera_index, score.pose_index) == (view.file, "test", 3, 1)
    assert 15 < score.train_view_angle_deg < 35
    np.testing.assert_array_equal(scored.truth, own_capture.read_image(view))
    assert scored.image.shape == scored.truth.shape


def test_views_far_from_every_training_camera_can_be_skipped(renderer, own_capture):
    def count(limit_deg):
        return len(list(scored_views(renderer, own_capture, own_capture.views, max_train_view_angle_deg=limit_deg)))

    assert (count(0.01), count(35.0), count(None)) == (6, 8, 8)
    untrained = replace(own_capture, views=own_capture.of_split("test"))
    assert np.isnan(scores_of(renderer, untrained, untrained.views)[0].train_view_angle_deg)
    with pytest.raises(LiveHandError, match="needs training images"):
        list(scored_views(renderer, untrained, untrained.views, max_train_view_angle_deg=25.0))


def test_a_distance_has_its_own_columns(renderer, own_capture):
    seen = []

    def between(image, truth):
        seen.append(tuple(truth.shape))
        return (image - truth).abs().max() + truth.mean()

    view = own_capture.of_split("test")[0]
    (score,) = scores_of(renderer, own_capture, [view], [Distance("mine", between)])
    assert 0 < score.figures["mine"] <= score.figures["mine_hand"]
    assert seen[0] == (1, 3, 32, 24)


def test_an_evaluation_during_training_leaves_the_networks_unchanged(renderer, hand, own_capture):
    avatar = renderer.avatar
    views = own_capture.of_split("test")
    for networks_train in (True, False):
        avatar.field.train(networks_train)
        avatar.superres.train(networks_train)
        scored = list(scored_views(Renderer(avatar, hand, "cpu"), own_capture, views))
        assert avatar.field.training is avatar.superres.training is networks_train
    assert [each.score.file for each in scored] == [view.file for view in views]
    assert summary([each.score for each in scored]) == summary(scores_of(renderer, own_capture, views))
    assert comparison_sheet([(each.truth, each.image) for each in scored]).shape == (32, 12 * 24, 3)


@pytest.fixture(scope="module")
def lit_capture(own_capture, renderer, hand, tmp_path_factory):
    """The same pictures as linear OpenEXR, 40 times as bright, in lights."""
    folder = tmp_path_factory.mktemp("lit")
    sun = Light((Lamp("sun", np.ones(3)),))
    lights = tuple(CaptureLight(kind, sun) for kind in ("soft", "key"))
    views = []
    for index, view in enumerate(own_capture.views):
        pose = own_capture.poses[view.pose_index]
        frame = renderer.render(Shot(pose, posed_vertices(hand, pose), view.camera, sun))
        channels = {name: 40 * frame.rgb[..., k] for k, name in enumerate("RGB")} | {"A": frame.alpha}
        lit = replace(view, file=f"images/{index}.exr", light=index % 2)
        write_exr(folder / lit.file, channels)
        views.append(lit)
    capture = replace(own_capture, folder=folder, views=tuple(views), lights=lights)
    save_capture_index(capture)
    return capture


def test_a_lit_view_is_rendered_in_its_light_and_exposed_by_its_truth(renderer, lit_capture, monkeypatch):
    factor, lights, render = 40.0, [], Renderer.render

    def brighter(self, shot):
        lights.append(shot.light)
        frame = render(self, shot)
        return replace(frame, rgb=factor * frame.rgb)

    monkeypatch.setattr(Renderer, "render", brighter)
    scored = list(scored_views(renderer, lit_capture, lit_capture.views))
    assert len(lights) == 8
    assert all(light.lamps is lit_capture.lights[index % 2].light.lamps for index, light in enumerate(lights))
    assert {light.shadow_quality for light in lights} == {"fine"}, "as frames that are kept"
    assert [view.score.light_kind for view in scored] == ["soft", "key"] * 4
    for view in scored:
        assert view.score.figures["psnr_hand"] > 60
        hand = view.truth[..., 3] > 0.5
        # The linear value 0.9 is encoded as 0.9547.
        assert np.percentile(view.truth[..., :3][hand], 99) == pytest.approx(0.9547, abs=1e-3)
        np.testing.assert_allclose(view.image, view.truth, atol=1e-3)
    factor = 20.0
    (darker,) = scored_views(renderer, lit_capture, lit_capture.views[:1])
    assert darker.score.figures["psnr_hand"] < 25
    np.testing.assert_array_equal(darker.truth, scored[0].truth)


def test_a_view_that_its_light_does_not_reach_is_skipped(renderer, lit_capture, tmp_path):
    view, other = lit_capture.views[:2]
    pixels = lit_capture.read_linear(view)
    pixels[..., :3] *= 1e-6
    dark = replace(lit_capture, folder=tmp_path, views=(view,))
    write_exr(tmp_path / view.file, {name: pixels[..., k] for k, name in enumerate("RGBA")})
    assert not list(scored_views(renderer, dark, dark.views))
    assert len(list(scored_views(renderer, lit_capture, (view, other)))) == 2


def test_the_command_tells_how_many_views_were_left_out(lit_capture, avatar_path, tmp_path, capsys):
    folder = tmp_path / "capture"
    shutil.copytree(lit_capture.folder, folder)
    arguments = (folder, "--avatar", avatar_path, "--device", "cpu", "--split", "all")
    assert evaluate(*arguments) == 0
    assert "left out" not in capsys.readouterr().out
    view = lit_capture.views[0]
    pixels = lit_capture.read_linear(view)
    pixels[..., :3] *= 1e-6
    write_exr(folder / view.file, {name: pixels[..., k] for k, name in enumerate("RGBA")})
    assert evaluate(*arguments) == 0
    assert "1 of 8 views were left out" in capsys.readouterr().out


def test_the_command_says_when_a_capture_shows_another_skin(hand, lit_capture, tmp_path, capsys):
    worn, numbers = load_avatar(shipped_avatar_path()).surface, surface_of_person(PERSONS["light"], hand.sha256)
    folder = tmp_path / "capture"
    shutil.copytree(lit_capture.folder, folder)
    for surface, is_other in ((worn, False), (numbers, True)):
        shown = whole_surface(surface)
        write_surface(folder / "surface.npz", shown)
        reference = SurfaceReference("surface.npz", surface_sha256(shown))
        save_capture_index(replace(lit_capture, folder=folder, surface=reference))
        assert evaluate(folder, "--device", "cpu", "--max-images", 1) == 0
        assert ("another skin" in capsys.readouterr().out) == is_other


def test_the_command_lists_kinds_of_light_and_contrast(lit_capture, avatar_path, tmp_path, capsys):
    arguments = (lit_capture.folder, "--avatar", avatar_path, "--device", "cpu", "-o", tmp_path / "out")
    assert evaluate(*arguments, "--split", "all", "--contrast") == 0
    _, *lines = capsys.readouterr().out.splitlines()
    expected = [["test", "key"], ["train", "key"], ["train", "soft"], ["test", "2"], ["train", "6"], ["all", "8"]]
    assert [line.split()[:2] for line in lines[:6]] == expected
    assert any(line.startswith("contrast, L*") for line in lines)
    written = json.loads((tmp_path / "out/summary.json").read_text())
    assert set(written["lights"]) == {"test key", "train key", "train soft"}
    assert written["lights"]["train key"]["images"] == 2


def test_views_without_the_hand_are_skipped_and_no_view_is_an_error(renderer, own_capture, tmp_path):
    view = own_capture.views[0]
    empty = replace(view, file=str(tmp_path / "empty.png"))
    Image.new("RGBA", view.camera.size_px).save(tmp_path / "empty.png")
    assert len(scores_of(renderer, own_capture, [view, empty])) == 1
    for views in ([empty], []):
        with pytest.raises(LiveHandError, match="must have views of the requested split"):
            check_any(scores_of(renderer, own_capture, views), own_capture)
    with pytest.raises(LiveHandError, match="another hand"):
        scores_of(renderer, replace(own_capture, hand_sha256="0" * 64), [view])


def test_frames_are_encoded_on_black():
    half_linear = ((0.5 + 0.055) / 1.055) ** 2.4
    alpha = np.array([[0.5, 0.0, 1.0]], np.float32)
    rgb = np.array([[[half_linear * 0.5] * 3, [0] * 3, [2.0, half_linear, 0]]], np.float32)
    image = encoded_on_black(Frame(rgb, alpha, np.zeros((1, 3), np.float32)))
    np.testing.assert_allclose(image, [[[0.25] * 3 + [0.5], [0] * 4, [1, 0.5, 0, 1]]], atol=1e-6)


@pytest.mark.parametrize("side", ["right", "left"])
def test_vertices_are_skinned(hand, own_capture, side):
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
    np.testing.assert_array_equal(sheet[0, [0, 2, 4], 0], [round(BACKGROUND * 255), 26, 102])
    np.testing.assert_allclose(on_background(truth), BACKGROUND)
    np.testing.assert_allclose(on_background(image), 0.1)
    save_sheet(sheet, tmp_path / "new" / "sheet.png")
    with Image.open(tmp_path / "new" / "sheet.png") as stored:
        np.testing.assert_array_equal(np.asarray(stored), sheet)


def test_images_keep_their_size_on_a_sheet(tmp_path):
    wide, high = np.ones((2, 6, 4), np.float32), np.ones((5, 3, 4), np.float32)
    sheet = comparison_sheet([(wide, wide), (high, high)], triples_per_row=1)
    assert sheet.shape == (10, 18, 3)
    np.testing.assert_array_equal((sheet[:, :, 0] == 255).sum(), 2 * (2 * 6 + 5 * 3))
    np.testing.assert_array_equal(sheet[5:, :3], np.full((5, 3, 3), 255))
    np.testing.assert_array_equal(sheet[5:, 3:6], round(BACKGROUND * 255))


def test_labels_stand_above_and_are_legible():
    picture = np.zeros((30, 100, 4), np.float32)
    plain = comparison_sheet([(picture, picture)] * 2, triples_per_row=1)
    strip = label_strip("38.55 dB", 300)
    labelled = comparison_sheet([(picture, picture)] * 2, 1, ["38.55 dB", ""])
    assert labelled.shape == (60 + 2 * len(strip), 300, 3)
    np.testing.assert_array_equal(labelled[len(strip) : len(strip) + 30], plain[:30])
    assert (strip > 0.6).any(axis=(0, 2)).sum() > 25  # columns that hold ink
    assert strip[:, 150:].max() == pytest.approx(BACKGROUND, abs=0.002)
    assert labelled[len(strip) + 30 : 2 * len(strip) + 30].max() == round(BACKGROUND * 255)


@pytest.fixture
def avatar_path(renderer, tmp_path):
    save_avatar(renderer.avatar, tmp_path / "mine.safetensors")
    return tmp_path / "mine.safetensors"


@pytest.fixture(autouse=True)
def nothing_fetched(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


def evaluate(*arguments):
    return run_commands("livehand", "", COMMANDS, ["evaluate", *map(str, arguments)])


def test_the_command_writes_figures_and_sheets(own_capture, avatar_path, tmp_path, capsys):
    out = tmp_path / "figures"
    arguments = (own_capture.folder, "--avatar", avatar_path, "-o", out, "--device", "cpu", "--worst", 1)
    assert evaluate(*arguments, "--json") == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["images"] == 2
    assert figures["psnr_full"] > 40  # weights went through half precision
    label = len(label_strip("", 1))
    for name, triples in (("contact_sheet.png", 4), ("worst.png", 2)):
        with Image.open(out / name) as sheet:
            assert sheet.size == (triples * 3 * 24, 32 + label)
    with (out / "scores.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [row["file"] for row in rows] == [view.file for view in own_capture.of_split("test")]
    for name in ("psnr_full", "psnr_hand", "ssim", "alpha_iou", "camera_gap_deg", "psnr_true_alpha"):
        assert np.mean([float(row[name]) for row in rows]) == pytest.approx(figures[name], abs=1e-2)
    written = json.loads((out / "summary.json").read_text())
    assert written["all"] == written["splits"]["test"] == figures
    assert written["avatar"] == str(avatar_path)
    assert f"{figures['psnr_hand']:.2f}" in (out / "summary.txt").read_text()
    assert "LPIPS was not measured" in (out / "summary.txt").read_text()
    assert not any("lpips" in name for name in rows[0])
    assert sorted(path.name for path in out.iterdir()) == sorted(
        ["contact_sheet.png", "scores.csv", "summary.json", "summary.txt", "worst.png"]
    )


def test_the_command_can_measure_fewer_views(own_capture, avatar_path, capsys):
    arguments = (own_capture.folder, "--avatar", avatar_path, "--device", "cpu", "--split", "all", "--json")
    counts = []
    for more in (("--max-images", 1), ("--max-images", 4), ("--max-train-view-angle", 1), ("--max-camera-gap", 1)):
        assert evaluate(*arguments, *more) == 0
        counts.append(json.loads(capsys.readouterr().out.splitlines()[-1])["images"])
    assert counts == [2, 6, 6, 6]
    for wrong in (("--max-images", 0), ("--max-train-view-angle", "near"), ("--max-camera-gap", -1)):
        assert evaluate(*arguments, *wrong) == 2
        assert "must be" in capsys.readouterr().err


@pytest.mark.parametrize(("more", "expected"), [((), True), (("--without-skin-detail",), False)])
def test_what_the_avatar_learnt_alone_is_measured_on_request(own_capture, avatar_path, monkeypatch, more, expected):
    seen = []
    render = Renderer.render
    monkeypatch.setattr(
        Renderer,
        "render",
        lambda self, *args, **named: seen.append(self.has_skin_detail) or render(self, *args, **named),
    )
    assert evaluate(own_capture.folder, "--avatar", avatar_path, "--device", "cpu", *more) == 0
    assert set(seen) == {expected}


def test_without_flip_its_columns_are_absent_and_the_remedy_is_printed(own_capture, avatar_path, monkeypatch, capsys):
    arguments = (own_capture.folder, "--avatar", avatar_path, "--device", "cpu")
    monkeypatch.setattr("livehand.backend.evaluation.figures.has_flip", lambda: False)
    assert evaluate(*arguments) == 0
    out = capsys.readouterr().out
    assert 'pip install "livehand[metrics]"' in out
    assert "FLIP  " not in out
    assert evaluate(*arguments, "--json") == 0
    assert "flip" not in json.loads(capsys.readouterr().out.splitlines()[-1])


def test_an_output_that_cannot_be_written_is_an_error(own_capture, avatar_path, tmp_path, capsys):
    (tmp_path / "taken").write_text("")
    arguments = (own_capture.folder, "--avatar", avatar_path, "--device", "cpu", "-o", tmp_path / "taken")
    assert evaluate(*arguments) == 1
    assert "choose another folder" in capsys.readouterr().err


def test_recorded_metrics_change_only_the_metadata(own_capture, avatar_path, capsys):
    before = load_avatar(avatar_path)
    assert evaluate(own_capture.folder, "--avatar", avatar_path, "--device", "cpu", "--json", "--record") == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    after = load_avatar(avatar_path)
    assert after.metrics == {**before.metrics, "test": figures}
    assert after.provenance == before.provenance
    for name, weights in before.superres.state_dict().items():
        assert after.superres.state_dict()[name].equal(weights)


def test_results_are_not_recorded_in_a_record_of_numbers(own_capture, tmp_path, capsys, monkeypatch):
    path = Path(shutil.copy(shipped_avatar_path("lena"), tmp_path))
    before = path.read_bytes()
    monkeypatch.setattr("livehand.backend.avatars.drawn_people.drawn_avatar", lambda hand, look, name, base: base)
    assert evaluate(own_capture.folder, "--avatar", path, "--device", "cpu", "--record") == 1
    error = capsys.readouterr().err
    assert "must be an avatar with networks to be written into" in error
    assert "new-person --seed 11 --age 24 --tone 0.04" in error
    assert path.read_bytes() == before


def test_the_command_selects_splits(own_capture, avatar_path, capsys):
    arguments = (own_capture.folder, "--avatar", avatar_path, "--device", "cpu")
    assert evaluate(*arguments, "--split", "all") == 0
    heading, *lines = capsys.readouterr().out.splitlines()
    assert heading.split()[0] == "images"
    assert [line.split()[:2] for line in lines[:3]] == [["test", "2"], ["train", "6"], ["all", "8"]]
    assert evaluate(*arguments, "--split", "held_out", "--json") == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["images"] == 2
    assert evaluate(*arguments, "--split", "train", "--json") == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["images"] == 6


def test_bad_input_is_an_error_of_the_command(own_capture, avatar_path, tmp_path, capsys):
    assert evaluate(tmp_path, "--avatar", avatar_path) == 1
    assert "transforms.json" in capsys.readouterr().err
    assert evaluate(own_capture.folder, "--avatar", tmp_path / "gone.safetensors") == 1
    assert "no avatar at" in capsys.readouterr().err
    assert evaluate(own_capture.folder, "--split", "best") == 2
