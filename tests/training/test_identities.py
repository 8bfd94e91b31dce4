"""One network for several people, a code each."""

import json

import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.identities import identity_names
from livehand.backend.capture.capture import index_document
from livehand.backend.system.command import run_commands
from livehand.livehand_blender.cli import COMMANDS
from PIL import Image

OPTIONS = ["--device", "cpu", "--seed", "0"]


@pytest.fixture(scope="module")
def blue_capture(painted_capture, tmp_path_factory):
    """The painted capture of somebody blue."""
    folder = tmp_path_factory.mktemp("blue")
    (folder / "poses.npz").write_bytes((painted_capture.folder / "poses.npz").read_bytes())
    (folder / "transforms.json").write_text(index_document(painted_capture))
    for view in painted_capture.views:
        pixels = painted_capture.read_pixels(view).copy()
        pixels[..., :3] = (20, 40, 220)
        Image.fromarray(pixels).save(folder / view.file)
    return folder


def livehand(*words):
    return run_commands("livehand", "", COMMANDS, [str(word) for word in words])


def _train_crowd(captures, path, steps):
    paper = ["--config", "paper", "--perceptual", "0", "--preview-minutes", "0", "--precision", "fp32", *OPTIONS]
    assert livehand("train", *captures, "-o", path, "--steps", steps, *paper, "--identities", "painted", "blue") == 0
    return path


@pytest.fixture(scope="module")
def crowd_path(painted_capture, blue_capture, tmp_path_factory):
    folder = tmp_path_factory.mktemp("crowd")
    return _train_crowd((painted_capture.folder, blue_capture), folder / "crowd.safetensors", 120)


@pytest.fixture(scope="module")
def begun_path(painted_capture, blue_capture, tmp_path_factory):
    """A training of two steps, which knows both people by name."""
    folder = tmp_path_factory.mktemp("begun")
    return _train_crowd((painted_capture.folder, blue_capture), folder / "begun.safetensors", 2)


@pytest.mark.slow
def test_the_avatar_names_its_people_and_their_captures(begun_path, painted_capture):
    avatar = load_avatar(begun_path)
    assert identity_names(avatar) == ("painted", "blue")
    assert avatar.provenance["capture"] == {"joined": [painted_capture.provenance] * 2}


@pytest.mark.nightly
def test_each_person_is_nearer_to_their_own_pictures(crowd_path, painted_capture, blue_capture, capsys):
    found = {
        (folder, name): _psnr(folder, crowd_path, name, capsys)
        for folder in (painted_capture.folder, blue_capture)
        for name in ("painted", "blue")
    }
    assert found[painted_capture.folder, "painted"] > found[painted_capture.folder, "blue"] + 3
    assert found[blue_capture, "blue"] > found[blue_capture, "painted"] + 3


def _psnr(folder, avatar, name, capsys):
    capsys.readouterr()
    words = ("evaluate", folder, "--avatar", avatar, "--device", "cpu", "--json", "--lpips", "none")
    assert livehand(*words, "--identity", name) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])["psnr_hand"]


@pytest.mark.nightly
def test_a_code_alone_is_fitted_to_one_more_person(crowd_path, blue_capture, tmp_path, capsys):
    path = tmp_path / "more.safetensors"
    assert livehand("identity", crowd_path, "--name", "cy", "--fit", blue_capture, "-o", path, "--steps", "60") == 0
    before, after = load_avatar(crowd_path), load_avatar(path)
    assert identity_names(after) == ("painted", "blue", "cy")
    for name, values in before.field.state_dict().items():
        assert torch.equal(after.field.state_dict()[name][: len(values)], values), name
    for name, values in before.superres.state_dict().items():
        assert torch.equal(after.superres.state_dict()[name], values), name
    assert _psnr(blue_capture, path, "cy", capsys) > _psnr(blue_capture, crowd_path, "mean", capsys) + 1


@pytest.mark.slow
def test_one_person_is_written_alone(begun_path, blue_capture, tmp_path, capsys):
    path = tmp_path / "blue.safetensors"
    assert livehand("identity", begun_path, "--name", "blue", "-o", path) == 0
    capsys.readouterr()
    assert livehand("inspect", path) == 0
    assert identity_names(load_avatar(path)) == ()
    assert livehand("identity", begun_path, "--name", "nobody", "-o", path) == 1
    assert "one of painted, blue or mean" in capsys.readouterr().err


def test_people_need_the_papers_networks_a_name_each_and_no_refinement(painted_capture, tmp_path, capsys):
    folder = painted_capture.folder
    wrong = {
        "got --config default": ["-o", tmp_path / "a.safetensors"],
        "got 1 names": ["-o", tmp_path / "a.safetensors", "--config", "paper", "--identities", "ann"],
        "--refine is of one": ["-o", tmp_path / "a.safetensors", "--config", "paper", "--refine"],
        "--camera-colours is of one": ["-o", tmp_path / "a.safetensors", "--config", "paper", "--camera-colours"],
        "must differ": ["-o", tmp_path / "a.safetensors", "--config", "paper", "--perceptual", "0"],
    }
    for message, words in wrong.items():
        assert livehand("train", folder, folder, *words) == 1
        assert message in capsys.readouterr().err, message


def test_a_blend_is_rendered_of_one_person_by_an_avatar_of_its_own(capsys):
    assert livehand("render", "shot.blend", "-o", "out", "--identity", "ann") == 1
    assert "livehand identity" in capsys.readouterr().err
