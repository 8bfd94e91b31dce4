"""Training on a tiny capture: it learns, goes on where it stopped, and refuses what is not its own."""

import json
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.evaluation.perceptual.vgg import PerceptualLoss
from livehand.backend.nerf.avatar import PRESETS, AvatarConfig, new_avatar
from livehand.backend.nerf.field import FieldConfig
from livehand.backend.nerf.rays import HandInView
from livehand.backend.nerf.sampler import SamplerConfig
from livehand.backend.nerf.superres import SuperResConfig
from livehand.backend.nerf.trace import trace
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.runtime.command import run_commands
from livehand.backend.training.checkpoint import TrainState, checkpoint_path, load_checkpoint
from livehand.backend.training.config import LossConfig, ReportConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.losses import LossTerms
from livehand.backend.training.parts import TrainedParts, optimiser_of
from livehand.backend.training.setup import TrainingSetup
from livehand.backend.training.step import Machine, Stepper
from livehand.backend.training.views import TrainingViews, _packed, _unpacked
from livehand.livehand_blender.cli import COMMANDS
from safetensors import safe_open

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)
CPU = torch.device("cpu")
SHORT = TrainConfig(steps=60, warmup_steps=5, checkpoint_every=20, learning_rate=1e-2, plane_learning_rate=3e-2)
SILENT = ReportConfig(preview_minutes=0.0)


@pytest.fixture
def losses(monkeypatch):
    """The loss of every step that is taken from here on."""
    seen, original = [], Stepper.take

    def noted(stepper, moment):
        result = original(stepper, moment)
        seen.append(result.terms["total"])
        return result

    monkeypatch.setattr(Stepper, "take", noted)
    return seen


def run(capture, hand, output, config=SHORT, resume=False, avatar_config=SMALL, precision="fp32", **task):
    task = TrainingSetup(capture, hand, avatar_config, **task)
    return train(task, config, output, Machine(CPU, precision), SILENT, resume).avatar


def test_it_learns_and_saves_what_it_learnt(painted_capture, hand, tmp_path, losses):
    output = tmp_path / "a.safetensors"
    avatar = run(painted_capture, hand, output)
    assert len(losses) == 60
    assert np.mean(losses[-6:]) < 0.62 * np.mean(losses[:6])
    back = load_avatar(output)
    assert (back.name, back.hand_sha256, back.config) == ("a", hand.sha256, SMALL)
    assert back.provenance["training"]["steps"] == 60
    assert back.provenance["capture"] == painted_capture.provenance
    for key, value in avatar.field.state_dict().items():
        torch.testing.assert_close(back.field.state_dict()[key], value.half().float())
    fresh = new_avatar("a", hand.name, hand.sha256, SMALL)
    assert not torch.equal(avatar.field.planes[0].table, fresh.field.planes[0].table)


def test_half_precision_learns_as_well(painted_capture, hand, tmp_path, losses):
    run(painted_capture, hand, tmp_path / "a.safetensors", replace(SHORT, steps=40), precision="bf16")
    assert np.mean(losses[-6:]) < 0.7 * np.mean(losses[:6])


class Killed(Exception):
    pass


def test_an_interrupted_run_ends_as_an_unbroken_one(painted_capture, hand, tmp_path, monkeypatch):
    whole = run(painted_capture, hand, tmp_path / "whole.safetensors")
    original, count = Stepper.take, Counter()

    def dies(stepper, moment):
        count["steps"] += 1
        if count["steps"] == 34:
            raise Killed
        return original(stepper, moment)

    output = tmp_path / "broken.safetensors"
    monkeypatch.setattr(Stepper, "take", dies)
    with pytest.raises(Killed):
        run(painted_capture, hand, output)
    assert checkpoint_path(output).is_file()
    assert not output.exists()
    resumed = run(painted_capture, hand, output, resume=True)
    assert count["steps"] == 34 + 40  # from the checkpoint after step 20
    for part in ("field", "superres"):
        expected = getattr(whole, part).state_dict()
        for key, value in getattr(resumed, part).state_dict().items():
            torch.testing.assert_close(value, expected[key], atol=1e-5, rtol=1e-4)


def test_without_resume_it_starts_anew(painted_capture, hand, tmp_path, losses):
    output = tmp_path / "a.safetensors"
    config = replace(SHORT, steps=4, checkpoint_every=2)
    first = run(painted_capture, hand, output, config)
    again = run(painted_capture, hand, output, config)
    assert len(losses) == 8
    assert losses[:4] == losses[4:]
    assert torch.equal(first.field.planes[0].table, again.field.planes[0].table)


def test_resuming_a_finished_run_takes_no_step(painted_capture, hand, tmp_path, losses):
    output, config = tmp_path / "a.safetensors", replace(SHORT, steps=4, checkpoint_every=2)
    run(painted_capture, hand, output, config)
    before = output.read_bytes()
    run(painted_capture, hand, output, config, resume=True)
    assert len(losses) == 4
    assert output.read_bytes() == before


@pytest.mark.parametrize(
    "other",
    [
        {"config": replace(SHORT, steps=5, checkpoint_every=2)},
        {"config": replace(SHORT, steps=4, checkpoint_every=2, seed=1)},
        {"avatar_config": replace(SMALL, superres=SuperResConfig(width=4, depth=2))},
    ],
)
def test_a_checkpoint_of_another_run_is_refused(painted_capture, hand, tmp_path, other):
    output, config = tmp_path / "a.safetensors", replace(SHORT, steps=4, checkpoint_every=2)
    run(painted_capture, hand, output, config)
    with pytest.raises(LiveHandError, match="must be of the same capture and settings"):
        run(painted_capture, hand, output, **{"config": config, **other}, resume=True)


def test_damaged_checkpoints_are_refused(painted_capture, hand, tmp_path):
    output, config = tmp_path / "a.safetensors", replace(SHORT, steps=4, checkpoint_every=2)
    run(painted_capture, hand, output, config)
    path = checkpoint_path(output)
    data = path.read_bytes()
    for spoilt in (b"", data[:100], data[:-1], output.read_bytes()):  # the last: a .safetensors of another kind
        path.write_bytes(spoilt)
        with pytest.raises(LiveHandError, match=r"a\.checkpoint"):
            run(painted_capture, hand, output, config, resume=True)


def test_a_checkpoint_holds_the_optimiser_too(painted_capture, hand, tmp_path):
    output, config = tmp_path / "a.safetensors", replace(SHORT, steps=4, checkpoint_every=4)
    avatar = run(painted_capture, hand, output, config)
    parts = TrainedParts(avatar)
    optimiser = optimiser_of(parts.requires_grad_(), config)
    path = checkpoint_path(output)
    progress = load_checkpoint(path, TrainState(parts, TrainedParts(avatar), optimiser), read_run(path))
    assert (progress.step, progress.skipped) == (4, 0)
    states = [optimiser.state[p] for group in optimiser.param_groups for p in group["params"]]
    assert all(float(state["step"]) == 4 for state in states if state)
    assert sum(bool(state) for state in states) == len(states)
    assert max(float(state["exp_avg"].abs().max()) for state in states) > 0


def read_run(path):
    with safe_open(path, framework="pt") as archive:
        return archive.metadata()["run"]


def test_a_capture_of_another_hand_or_without_views_is_refused(painted_capture, hand, tmp_path):
    output = tmp_path / "a.safetensors"
    with pytest.raises(LiveHandError, match="must be of hand"):
        run(replace(painted_capture, hand_sha256="0" * 64), hand, output)
    with pytest.raises(LiveHandError, match="must have training images"):
        run(replace(painted_capture, views=painted_capture.of_split("test")), hand, output)
    left = HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3), "left")
    with pytest.raises(LiveHandError, match="must all be of the right hand"):
        run(replace(painted_capture, poses=(left, left)), hand, output)
    assert not output.exists()


@pytest.fixture(scope="module")
def views(painted_capture, hand):
    return TrainingViews(painted_capture, painted_capture.of_split("train"), hand, SMALL.sampler, CPU, 0)


def test_a_view_is_the_image_in_its_window(painted_capture, views):
    view = views.get(1, 0)
    image = painted_capture.read_image(views.views[1])
    height, width = view.is_inside.shape
    assert (view.view.size_px[0] * 2, view.view.size_px[1] * 2) == (width, height)
    assert int(view.is_inside.sum()) > 0
    inside = view.target[:, view.is_inside]
    assert view.target[:, ~view.is_inside].abs().max() == 0
    assert inside[3].sum() == pytest.approx(image[..., 3].sum(), rel=1e-3)  # all of the hand is in the window
    torch.testing.assert_close(inside[:3].sum(1), torch.as_tensor(image[..., :3].sum((0, 1))), rtol=1e-3, atol=1e-2)


def test_kept_rays_are_traced_ones_to_a_few_micrometres(views):
    view = views.get(0, 1)
    generator = torch.Generator().manual_seed(hash((0, 0, 1)) % 2**63)
    traced = trace(HandInView(view.mesh, views.topology, view.view), SMALL.sampler, generator)
    for name in ("pixel", "directions", "t", "dt"):
        torch.testing.assert_close(getattr(view.rays, name), getattr(traced, name))
    assert torch.equal(view.rays.samples.face, traced.samples.face)
    assert (view.rays.samples.height_m - traced.samples.height_m).abs().max() < 3e-6
    corners = view.mesh.vertices[views.topology.faces[traced.samples.face]]
    moved = (view.rays.samples.barycentric - traced.samples.barycentric)[:, :, None] * corners
    assert moved.sum(1).norm(dim=-1).max() < 5e-6
    torch.testing.assert_close(view.rays.samples.barycentric.sum(1), torch.ones(len(corners)))


@pytest.mark.parametrize("face", [0, 2**15 - 1, 2**15, 10**6])
def test_faces_of_dense_hands_are_kept_too(views, face):
    view = views.get(0, 0)
    samples = view.rays.samples
    dense = view.rays._replace(samples=samples._replace(face=torch.full_like(samples.face, face)))
    assert (_unpacked(_packed(dense), view.view).samples.face == face).all()


def test_jitters_differ_and_stay(views):
    one, again, other = views.get(2, 0), views.get(2, 0), views.get(2, 1)
    assert torch.equal(one.rays.t, again.rays.t)
    assert not torch.equal(one.rays.t, other.rays.t)


def test_views_without_the_hand_are_left_out(painted_capture, hand):
    view = painted_capture.views[0]
    away = replace(view, camera=replace(view.camera, cam2world=view.camera.cam2world @ np.diag([1.0, -1, -1, 1])))
    views = TrainingViews(painted_capture, (view, away), hand, SMALL.sampler, CPU, 0)
    assert len(views) == 1


def test_the_last_part_has_the_perceptual_term(painted_capture, hand, tmp_path, monkeypatch):
    config = replace(SHORT, steps=10, loss=LossConfig(perceptual_share=0.3, perceptual_rise=0.0))
    perceptual = PerceptualLoss.__new__(PerceptualLoss)
    torch.nn.Module.__init__(perceptual)
    used = []

    def noted(low, image, target, is_inside, config, perceptual, *more):
        used.append(perceptual is not None)
        return LossTerms(*[image.square().mean()] * 6)

    monkeypatch.setattr("livehand.backend.training.step.window_loss", noted)
    run(painted_capture, hand, tmp_path / "a.safetensors", config, perceptual=perceptual)
    assert used == [False] * 7 + [True] * 3


def test_the_command_trains(painted_capture, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(PRESETS, "default", SMALL)
    output = tmp_path / "new" / "a.safetensors"
    arguments = ["train", str(painted_capture.folder), "-o", str(output), "--steps", "3", "--perceptual", "0"]
    assert run_commands("livehand", "", COMMANDS, [*arguments, "--device", "cpu", "--json"]) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["steps"] == 3
    assert 0 <= result["data_wait_share"] < 1
    assert result["held_out"]["psnr_hand"] > 5
    assert load_avatar(output).provenance["precision"] == "bf16"


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (["-o", "a.pth"], "must end in .safetensors"),
        (["--hand", "gone.npz"], "no hand model at gone.npz"),
        (["--perceptual-weights", "gone.pth"], "no perceptual weights at gone.pth"),
        (["--steps", "0"], "steps"),
        (["--minutes", "0"], "must be a number of minutes above 0, got '0'"),
        (["--minutes", "5", "--steps", "5"], "not allowed with argument"),
        (["--batch", "two"], "must be a whole number from 1"),
        (["--ema-decay", "1"], "must be a number from 0 to below 1"),
        (["--from", "gone.safetensors"], "no avatar at gone.safetensors"),
    ],
)
def test_the_command_tells_bad_input(painted_capture, tmp_path, capsys, changes, message):
    arguments = ["train", str(painted_capture.folder), "-o", str(tmp_path / "a.safetensors"), "--device", "cpu"]
    assert run_commands("livehand", "", COMMANDS, [*arguments, *changes]) in (1, 2)
    assert message in capsys.readouterr().err


def test_the_command_fine_tunes_for_a_time(painted_capture, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(PRESETS, "default", SMALL)
    outputs = [str(tmp_path / name) for name in ("a.safetensors", "b.safetensors")]
    common = ["--perceptual", "0", "--device", "cpu", "--preview-minutes", "0", "--json"]
    lengths = (["--steps", "1"], ["--minutes", "0.005", "--batch", "2", "--from", outputs[0], "--ema-decay", "0.5"])
    for output, length in zip(outputs, lengths, strict=True):
        arguments = ["train", str(painted_capture.folder), "-o", output, *length, *common]
        assert run_commands("livehand", "", COMMANDS, arguments) == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert result["steps"] >= 1
    assert result["minutes"] >= 0.005
    assert result["held_out"] == {}
    provenance = load_avatar(outputs[1]).provenance
    assert provenance["fine_tuned_from"]["name"] == "a"
    settings = provenance["training"]
    assert (settings["minutes"], settings["batch"], settings["ema_decay"]) == (0.005, 2, 0.5)


def test_the_seed_is_part_of_the_run(painted_capture, hand, tmp_path, losses):
    config = replace(SHORT, steps=3)
    run(painted_capture, hand, tmp_path / "a.safetensors", config)
    run(painted_capture, hand, tmp_path / "b.safetensors", replace(config, seed=5))
    assert losses[:3] != losses[3:]
