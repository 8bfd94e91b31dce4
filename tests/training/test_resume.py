"""Training that is killed ends as if it had not been; time that is spent stays spent."""

import json
import signal
import subprocess
import sys
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.nerf.avatar import AvatarConfig
from livehand.backend.nerf.field import FieldConfig
from livehand.backend.nerf.sampler import SamplerConfig
from livehand.backend.nerf.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training.checkpoint import Progress, TrainState, checkpoint_path, load_checkpoint, save_checkpoint
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.loop import train
from livehand.backend.training.setup import TrainingSetup
from livehand.backend.training.processes import ComputeSetup

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)
CPU = torch.device("cpu")
SILENT = ReportConfig(preview_minutes=0.0, log_every=5)
CONFIG = TrainConfig(steps=30, warmup_steps=5, checkpoint_every=10, learning_rate=1e-2)

# The second checkpoint's file is written but not yet in its place when the process is killed.
KILLED = """
import json, os, signal, sys
from pathlib import Path
import torch
from livehand.backend.captures.capture import load_capture
from livehand.backend.training import checkpoint
sys.path.insert(0, sys.argv[1])
from test_resume import CONFIG, SILENT, SMALL, CPU, Machine, TrainingSetup, load_default_hand, train

replace, count = Path.replace, [0]

def dies(path, target):
    count[0] += path.suffix == ".checkpoint_partial"
    if count[0] == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return replace(path, target)

Path.replace = dies
setup = TrainingSetup(load_capture(sys.argv[2]), load_default_hand(), SMALL)
train(setup, CONFIG, Path(sys.argv[3]), ComputeSetup(CPU), SILENT)
"""


@pytest.fixture
def task(painted_capture):
    return TrainingSetup(painted_capture, load_default_hand(), SMALL)


def weights(avatar):
    return {**avatar.field.state_dict(), **{f"superres.{k}": v for k, v in avatar.superres.state_dict().items()}}


def test_a_run_killed_while_it_writes_ends_as_an_unbroken_one(task, tmp_path):
    whole = train(task, CONFIG, tmp_path / "whole.safetensors", ComputeSetup(CPU), SILENT)
    output = tmp_path / "broken.safetensors"
    arguments = (str(Path(__file__).parent), str(task.capture.folder), str(output))
    killed = subprocess.run([sys.executable, "-c", KILLED, *arguments], capture_output=True, text=True, timeout=120)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert output.with_suffix(".checkpoint_partial").is_file()
    assert not output.exists()
    resumed = train(task, CONFIG, output, ComputeSetup(CPU), SILENT, resume=True)
    assert resumed.progress.step == 30
    for key, value in weights(resumed.avatar).items():
        torch.testing.assert_close(value, weights(whole.avatar)[key], atol=1e-5, rtol=1e-4)
    steps = [json.loads(line)["step"] for line in (tmp_path / "broken.log.jsonl").read_text().splitlines()]
    assert steps == [5, 10, 15, 20, 25, 30]  # those after the checkpoint of step 10 once only


def test_the_average_is_saved_and_resumed(task, tmp_path):
    config = replace(CONFIG, steps=8, ema_decay=0.5, checkpoint_every=3)
    output = tmp_path / "a.safetensors"
    outcome = train(task, config, output, ComputeSetup(CPU), SILENT)
    last = train(task, replace(config, ema_decay=0.0), tmp_path / "b.safetensors", ComputeSetup(CPU), SILENT)
    saved = weights(load_avatar(output))
    for key, value in weights(outcome.avatar).items():
        torch.testing.assert_close(saved[key], value.half().float())
    assert any(not torch.equal(value, saved[key]) for key, value in weights(load_avatar(last_path(tmp_path))).items())
    again = train(task, config, output, ComputeSetup(CPU), SILENT, resume=True)
    for key, value in weights(again.avatar).items():
        assert torch.equal(value, weights(outcome.avatar)[key])
    assert last.progress.step == again.progress.step == 8


def last_path(folder):
    return folder / "b.safetensors"


@pytest.fixture
def ticking(monkeypatch):
    """A clock on which a second passes whenever anybody looks."""
    now = [0.0]

    def tick():
        now[0] += 1
        return now[0]

    monkeypatch.setattr("livehand.backend.training.clock.monotonic", tick)
    return now


def test_a_budget_of_time_ends_training_and_resuming_counts_what_is_spent(task, tmp_path, ticking):
    config = replace(CONFIG, minutes=2.0, steps=1, checkpoint_every=1)
    output = tmp_path / "a.safetensors"
    whole = train(task, config, output, ComputeSetup(CPU), SILENT)
    assert 120 <= whole.progress.seconds < 130
    assert 5 < whole.progress.step < 60
    assert load_avatar(output).provenance["steps_taken"] == whole.progress.step
    before = output.read_bytes()
    again = train(task, config, output, ComputeSetup(CPU), SILENT, resume=True)
    assert again.progress.step == whole.progress.step
    assert output.read_bytes() == before


def test_a_resumed_budget_has_only_its_rest(task, tmp_path, ticking, monkeypatch):
    config = replace(CONFIG, minutes=2.0, checkpoint_every=1)
    output = tmp_path / "a.safetensors"

    def half(path, state, progress, run):
        save_checkpoint(path, state, progress, run)
        if progress.seconds > 60:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("livehand.backend.training.loop.save_checkpoint", half)
        with pytest.raises(KeyboardInterrupt):
            train(task, config, output, ComputeSetup(CPU), SILENT)
    start = ticking[0]
    resumed = train(task, config, output, ComputeSetup(CPU), SILENT, resume=True)
    assert 120 <= resumed.progress.seconds < 130
    assert ticking[0] - start < 75


def test_a_checkpoint_comes_after_minutes_too(task, tmp_path, ticking, monkeypatch):
    saved = []
    monkeypatch.setattr("livehand.backend.training.loop.save_checkpoint", lambda *arguments: saved.append(arguments[2]))
    train(task, replace(CONFIG, checkpoint_every=1000, checkpoint_minutes=1.0), tmp_path / "a", ComputeSetup(CPU), SILENT)
    assert len(saved) > 2
    assert saved[-1].step == 30
    times = [progress.seconds for progress in saved[:-1]]
    assert min(b - a for a, b in pairwise(times)) >= 55


def test_a_checkpoint_gives_back_its_progress(tmp_path):
    module = torch.nn.Linear(2, 2)
    state = TrainState(module, torch.nn.Linear(2, 2), torch.optim.Adam(module.parameters()))
    path = checkpoint_path(tmp_path / "a.safetensors")
    progress = Progress(7, 12.625, 2)
    save_checkpoint(path, state, progress, "run")
    other = TrainState(torch.nn.Linear(2, 2), torch.nn.Linear(2, 2), state.optimiser)
    assert asdict(load_checkpoint(path, other, "run")) == asdict(progress)
    assert torch.equal(other.parts.weight, module.weight)
    assert torch.equal(other.average.weight, state.average.weight)
    assert not torch.equal(other.average.weight, other.parts.weight)


def test_a_checkpoint_that_cannot_be_written_is_told(tmp_path):
    module = torch.nn.Linear(2, 2)
    state = TrainState(module, torch.nn.Linear(2, 2), torch.optim.Adam(module.parameters()))
    with pytest.raises(LiveHandError, match=r"checkpoint .*gone/a\.checkpoint must be writable, got .*--resume"):
        save_checkpoint(checkpoint_path(tmp_path / "gone" / "a.safetensors"), state, Progress(), "run")
