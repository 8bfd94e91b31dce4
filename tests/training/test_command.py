"""The command `livehand train`."""

import argparse
import json
import shutil
from dataclasses import replace

import pytest
import torch
from livehand.backend.avatars.avatar import PRESETS
from livehand.backend.avatars.file import load_avatar
from livehand.backend.capture.capture import index_document
from livehand.backend.evaluation.perceptual.vgg import PerceptualLoss
from livehand.backend.surface.skin_version import SKIN_VERSION, skin_version
from livehand.backend.system.command import run_commands
from livehand.backend.training.command import PRESET_NAMES, _brought, _config_of
from livehand.backend.training.config import TrainConfig
from livehand.backend.training.losses import crop_loss
from livehand.backend.training.schedule import Schedule
from livehand.livehand_blender.cli import COMMANDS


@pytest.fixture(autouse=True)
def _small_networks(small, monkeypatch):
    monkeypatch.setitem(PRESETS, "default", small)


def test_the_command_knows_the_presets():
    assert tuple(PRESETS) == PRESET_NAMES


class AbsoluteDistance(PerceptualLoss):
    """Stands for LPIPS, of a value that is known."""

    def __init__(self):
        torch.nn.Module.__init__(self)

    def forward(self, image, target):
        return (image - target).abs().mean()


def config_of(*options):
    parser = argparse.ArgumentParser()
    COMMANDS["train"].add_arguments(parser)
    argv = ["capture", "-o", "a.safetensors", *options]
    args = parser.parse_args(argv)
    args.argv = tuple(argv)
    return _config_of(args)


def test_the_papers_configuration_is_its_training_and_options_replace_its_parts():
    paper = config_of("--config", "paper")
    assert (paper.steps, paper.batch, paper.learning_rate, paper.warmup_steps) == (300_000, 1, 2.5e-3, 1)
    rates = [Schedule(paper).at(step).rate_factor for step in (0, 125_000, 250_000)]
    assert rates == pytest.approx([1, 0.1**0.5, 0.1])
    assert [Schedule(paper).at(step).perceptual_factor for step in (0, 299_999)] == [1, 1]
    assert config_of("--config", "default") == config_of() == TrainConfig()
    changed = config_of("--config", "paper", "--steps", "10000", "--perceptual=0.01", "--licence", "CC0")
    assert changed == replace(paper, steps=10_000, licence="CC0", loss=replace(paper.loss, perceptual=0.01))


def test_the_papers_loss_is_squared_error_and_lpips_one_to_one_at_both_resolutions():
    target, distance = torch.zeros(4, 8, 8), AbsoluteDistance()
    image, low = target + 0.2, target[:, ::2, ::2] + 0.1
    image[3], low[3] = 0, 0
    inside = torch.ones(8, 8, dtype=torch.bool)
    terms = crop_loss(low, image, target, inside, config_of("--config", "paper").loss, distance)
    parts = terms._replace(total=torch.zeros(()))
    assert [float(part) for part in parts] == pytest.approx([0.2**2, 0, 0, 0.1**2, 0.2 + 0.1, 0], abs=1e-7)


def test_the_papers_training_asks_for_lpips_and_calibrates_cameras(painted_capture, tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    command = ["train", str(painted_capture.folder), "-o", str(tmp_path / "a.safetensors"), "--config", "paper"]
    assert run_commands("livehand", "", COMMANDS, [*command, "--steps", "1", "--device", "cpu"]) == 1
    assert "LPIPS by vgg16 needs its weights" in capsys.readouterr().err
    options = ["--steps", "2", "--perceptual", "0", "--device", "cpu", "--preview-minutes", "0", "--precision", "fp32"]
    assert run_commands("livehand", "", COMMANDS, [*command, *options]) == 0
    provenance = load_avatar(tmp_path / "a.safetensors").provenance
    assert provenance["corrections"] == {"camera_colours": {"worn_cameras": []}}
    assert provenance["training"]["decay"] == "exponential"


def test_the_command_trains(painted_capture, tmp_path, capsys):
    output = tmp_path / "new" / "a.safetensors"
    arguments = ["train", str(painted_capture.folder), "-o", str(output), "--steps", "3", "--perceptual", "0"]
    assert run_commands("livehand", "", COMMANDS, [*arguments, "--device", "cpu", "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["steps"] == 3
    assert 0 <= result["data_wait_share"] < 1
    assert result["held_out"]["psnr_hand"] > 5
    assert load_avatar(output).provenance["precision"] == "bf16"


@pytest.mark.parametrize(("version", "is_determined"), [(None, False), (skin_version(), False), ("0" * 12, True)])
def test_a_capture_of_an_earlier_skin_is_told(painted_capture, tmp_path, capsys, version, is_determined):
    reported = {} if version is None else {SKIN_VERSION: version}
    capture = replace(painted_capture, provenance={**painted_capture.provenance, **reported})
    folder = tmp_path / "capture"
    shutil.copytree(painted_capture.folder, folder)
    (folder / "transforms.json").write_text(index_document(capture))
    arguments = ["train", str(folder), "-o", str(tmp_path / "a.safetensors"), "--steps", "1", "--perceptual", "0"]
    assert run_commands("livehand", "", COMMANDS, [*arguments, "--device", "cpu", "--preview-minutes", "0"]) == 0
    assert ("built-in skin of another version" in capsys.readouterr().err) == is_determined


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["-o", "a.pth"], "must end in .safetensors"),
        (["--hand", "gone.npz"], "no hand model at gone.npz"),
        (["--perceptual-weights", "gone.pth"], "no perceptual weights at gone.pth"),
        (["--config", "relightable", "--camera-colours", "--perceptual", "0"], "--camera-colours would be lost"),
        (["--steps", "0"], "steps"),
        (["--minutes", "0"], "must be a number of minutes above 0, got '0'"),
        (["--minutes", "5", "--steps", "5"], "not allowed with argument"),
        (["--batch", "two"], "must be a whole number from 1"),
        (["--ema-decay", "1"], "must be a number from 0 to below 1"),
        (["--from", "gone.safetensors"], "no avatar at gone.safetensors"),
    ],
)
def test_bad_input_is_refused(painted_capture, tmp_path, capsys, changes, message):
    arguments = ["train", str(painted_capture.folder), "-o", str(tmp_path / "a.safetensors"), "--device", "cpu"]
    assert run_commands("livehand", "", COMMANDS, [*arguments, *changes]) in (1, 2)
    assert message in capsys.readouterr().err


def test_the_command_fine_tunes_for_a_time(painted_capture, tmp_path, capsys):
    outputs = [str(tmp_path / name) for name in ("a.safetensors", "b.safetensors")]
    common = ["--perceptual", "0", "--device", "cpu", "--preview-minutes", "0", "--json"]
    lengths = (["--steps", "1"], ["--minutes", "0.005", "--batch", "2", "--from", outputs[0], "--ema-decay", "0.5"])
    for output, length in zip(outputs, lengths, strict=True):
        arguments = ["train", str(painted_capture.folder), "-o", output, *length, *common]
        assert run_commands("livehand", "", COMMANDS, arguments) == 0
    printed = capsys.readouterr()
    result = json.loads(printed.out.splitlines()[-1])
    assert result["steps"] >= 1
    assert printed.err.count("steps, below 1,000") == 1  # of the budget of minutes alone
    assert result["minutes"] >= 0.005
    assert result["held_out"] == {}
    provenance = load_avatar(outputs[1]).provenance
    assert provenance["fine_tuned_from"]["name"] == "a"
    settings = provenance["training"]
    assert (settings["minutes"], settings["batch"], settings["ema_decay"]) == (0.005, 2, 0.5)


@pytest.mark.parametrize(("given", "kept"), [([], "crop"), (["patch"], "patch")])
def test_the_avatar_says_which_region_the_perceptual_term_saw(painted_capture, tmp_path, given, kept):
    output = tmp_path / "a.safetensors"
    arguments = ["train", str(painted_capture.folder), "-o", str(output), "--steps", "1", "--perceptual", "0"]
    region = ["--perceptual-region", *given] if given else []
    assert (
        run_commands("livehand", "", COMMANDS, [*arguments, *region, "--device", "cpu", "--preview-minutes", "0"]) == 0
    )
    assert load_avatar(output).provenance["training"]["loss"]["perceptual_region"] == kept


@pytest.mark.parametrize(("after_db", "said"), [(26.04, "lost 2.0 dB by training; keep the person"), (28.1, "")])
def test_a_training_that_did_harm_is_told(capsys, after_db, said):
    brought = _brought("keep the person", 28.0, after_db)
    assert brought == {"held_out_before_db": 28.0, "brought_db": round(after_db - 28, 2)}
    told = capsys.readouterr().err
    assert said in told
    assert bool(told) == bool(said)
