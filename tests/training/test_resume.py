"""Training that is killed and resumed gives the result of an uninterrupted one, and its time keeps counting."""

import json
import signal
import subprocess
import sys
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from livehand.backend.avatars.avatar import AvatarConfig
from livehand.backend.avatars.file import load_avatar
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.training import checkpoint, loop
from livehand.backend.training.checkpoint import Progress, TrainState, checkpoint_path, load_checkpoint, save_checkpoint
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.loop import Training, train
from livehand.backend.training.parts import Correction
from livehand.backend.training.processes import ComputeSetup
from livehand.backend.training.schedule import Clock
from safetensors import safe_open
from safetensors.torch import save_file

SMALL = AvatarConfig(
    FieldConfig(width=16, planes=((32, 2, 4),), relief=8), SuperResConfig(width=8, depth=2), SamplerConfig(4, 0.003)
)
COMPUTE = ComputeSetup(torch.device("cpu"))
SILENT = ReportConfig(preview_minutes=0.0, log_every=5)
CONFIG = TrainConfig(steps=30, warmup_steps=5, checkpoint_every=10, learning_rate=1e-2)

# The process is killed when the second checkpoint's file is written but not yet in its place.
KILLED = """
import json, os, signal, sys
from pathlib import Path
import torch
from livehand.backend.capture.capture import load_capture
from livehand.backend.training import checkpoint
sys.path.insert(0, sys.argv[1])
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.training.loop import train
from livehand.backend.training.setup import TrainingSetup
from test_resume import COMPUTE, CONFIG, SILENT, SMALL

replace, count = os.replace, [0]

def replace_or_die(path, target):
    count[0] += str(path).endswith(".partial.checkpoint")
    if count[0] == 2:
        os.kill(os.getpid(), signal.SIGKILL)
    return replace(path, target)

os.replace = replace_or_die
setup = TrainingSetup(load_capture(sys.argv[2]), load_default_hand(), SMALL)
train(setup, CONFIG, Path(sys.argv[3]), COMPUTE, SILENT)
"""


def test_a_run_killed_while_writing_gives_the_result_of_an_uninterrupted_one(setup, tmp_path, weights_of, log_of):
    whole = train(setup, CONFIG, tmp_path / "whole.safetensors", COMPUTE, SILENT)
    output = tmp_path / "broken.safetensors"
    arguments = (str(Path(__file__).parent), str(setup.capture.folder), str(output))
    killed = subprocess.run([sys.executable, "-c", KILLED, *arguments], capture_output=True, text=True, timeout=120)
    assert killed.returncode == -signal.SIGKILL, killed.stderr
    assert len(list(tmp_path.glob(".broken.*.partial.checkpoint"))) == 1
    assert not output.exists()
    resumed = train(setup, CONFIG, output, COMPUTE, SILENT, resume=True)
    assert resumed.progress.step == 30
    for key, value in weights_of(resumed.avatar).items():
        torch.testing.assert_close(value, weights_of(whole.avatar)[key], atol=1e-5, rtol=1e-4)
    steps = [entry["step"] for entry in log_of(output)]
    assert steps == [5, 10, 15, 20, 25, 30]  # those after the checkpoint of step 10 once only


def test_a_run_that_ends_before_its_avatar_is_saved_loses_no_line_of_its_log(setup, tmp_path, monkeypatch, log_of):
    output, reporting = tmp_path / "broken.safetensors", replace(SILENT, log_every=20)

    def interrupted(avatar, path):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(loop, "save_avatar", interrupted)
        with pytest.raises(KeyboardInterrupt):
            train(setup, CONFIG, output, COMPUTE, reporting)
    assert not output.exists()
    train(setup, CONFIG, output, COMPUTE, reporting, resume=True)
    assert output.exists()
    assert [entry["step"] for entry in log_of(output)] == [20, 30]


def test_the_average_is_saved_and_resumed(setup, tmp_path, weights_of):
    config = replace(CONFIG, steps=8, ema_decay=0.5, checkpoint_every=3)
    output = tmp_path / "a.safetensors"
    result = train(setup, config, output, COMPUTE, SILENT)
    last = train(setup, replace(config, ema_decay=0.0), tmp_path / "b.safetensors", COMPUTE, SILENT)
    saved = weights_of(load_avatar(output))
    for key, value in weights_of(result.avatar).items():
        torch.testing.assert_close(saved[key], value.half().float())
    assert any(
        not torch.equal(value, saved[key]) for key, value in weights_of(load_avatar(tmp_path / "b.safetensors")).items()
    )
    again = train(setup, config, output, COMPUTE, SILENT, resume=True)
    for key, value in weights_of(again.avatar).items():
        assert torch.equal(value, weights_of(result.avatar)[key])
    assert last.progress.step == again.progress.step == 8


class TickingClock:
    """A time that advances by a second whenever it is read; reading it after `end_s` interrupts the training."""

    def __init__(self, end_s=None):
        self.now, self.end_s = 0.0, end_s

    def __call__(self):
        self.now += 1
        if self.end_s is not None and self.now > self.end_s:
            raise KeyboardInterrupt
        return self.now


def run_on(time, setup, config, output, resume=False):
    return Training(setup, config, output, COMPUTE, resume, Clock(now=time)).run(SILENT)


def test_a_time_budget_ends_training_and_resuming_counts_the_time_spent(setup, tmp_path):
    config = replace(CONFIG, minutes=2.0, steps=1, checkpoint_every=1)
    output = tmp_path / "a.safetensors"
    whole = run_on(TickingClock(), setup, config, output)
    assert 120 <= whole.progress.seconds < 130
    assert 5 < whole.progress.step < 60
    assert load_avatar(output).provenance["steps_taken"] == whole.progress.step
    before = output.read_bytes()
    again = run_on(TickingClock(), setup, config, output, resume=True)
    assert again.progress.step == whole.progress.step
    assert output.read_bytes() == before


def test_a_resumed_budget_has_only_the_remaining_time(setup, tmp_path):
    config = replace(CONFIG, minutes=2.0, checkpoint_every=1)
    output = tmp_path / "a.safetensors"
    with pytest.raises(KeyboardInterrupt):
        run_on(TickingClock(end_s=66), setup, config, output)
    time = TickingClock()
    resumed = run_on(time, setup, config, output, resume=True)
    assert 120 <= resumed.progress.seconds < 130
    assert time.now < 75


def test_a_checkpoint_comes_after_minutes_too(setup, tmp_path):
    output, saved = tmp_path / "a.safetensors", []

    def read_progress(*_):
        if checkpoint_path(output).is_file():
            with safe_open(checkpoint_path(output), framework="pt") as archive:
                saved.append(json.loads(archive.metadata()["progress"]))

    setup = replace(setup, corrections=(Correction("reader", torch.nn.Module(), 0.0, begin=read_progress),))
    run_on(TickingClock(), setup, replace(CONFIG, checkpoint_every=1000, checkpoint_minutes=1.0), output)
    read_progress()
    assert saved[-1]["step"] == 30
    times = sorted({progress["seconds"] for progress in saved[:-1]})
    assert len(times) > 1
    assert min(b - a for a, b in pairwise(times)) >= 55


def test_a_checkpoint_restores_its_progress(tmp_path):
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


def test_a_checkpoint_that_cannot_be_written_is_reported(tmp_path):
    module = torch.nn.Linear(2, 2)
    state = TrainState(module, torch.nn.Linear(2, 2), torch.optim.Adam(module.parameters()))
    (tmp_path / "file").touch()
    with pytest.raises(LiveHandError, match=r"file/a\.checkpoint must be writable"):
        save_checkpoint(checkpoint_path(tmp_path / "file" / "a.safetensors"), state, Progress(), "run")


def test_a_flipped_bit_of_a_checkpoint_is_found_and_so_is_a_missing_checksum(tmp_path):
    module = torch.nn.Linear(2, 2)
    state = TrainState(module, torch.nn.Linear(2, 2), torch.optim.Adam(module.parameters()))
    path = checkpoint_path(tmp_path / "a.safetensors")
    save_checkpoint(path, state, Progress(7), "run")
    data = bytearray(path.read_bytes())
    data[-1] ^= 0x40
    path.write_bytes(data)
    with pytest.raises(LiveHandError, match="checksum"):
        load_checkpoint(path, state, "run")
    with safe_open(path, framework="pt") as archive:
        metadata, tensors = archive.metadata(), {key: archive.get_tensor(key) for key in archive.keys()}
    metadata.pop("sha256")
    save_file(tensors, path, metadata=metadata)
    with pytest.raises(LiveHandError, match="checksum"):
        load_checkpoint(path, state, "run")


def write_checkpoint(path, tensors, progress):
    """A checkpoint of the run `run` with a correct checksum, whatever it holds."""
    metadata = {"progress": progress, "run": "run"}
    save_file(tensors, path, metadata={**metadata, "sha256": checkpoint._checksum(metadata, tensors)})


@pytest.mark.parametrize(
    "progress",
    ["[]", "5", '{"step": 7, "x": 1}', '{"step": null}', '{"step": -1}', '{"seconds": Infinity}', "[" * 5000],
)
def test_a_checkpoint_whose_progress_is_none_is_refused_in_words(tmp_path, progress):
    module = torch.nn.Linear(2, 2)
    state = TrainState(module, torch.nn.Linear(2, 2), torch.optim.Adam(module.parameters()))
    path = checkpoint_path(tmp_path / "a.safetensors")
    write_checkpoint(path, state.tensors(), progress)
    with pytest.raises(LiveHandError, match="delete it to start again"):
        load_checkpoint(path, state, "run")


def test_a_checkpoint_of_other_sizes_is_refused_in_words(tmp_path):
    module = torch.nn.Linear(2, 2)
    state = TrainState(module, torch.nn.Linear(2, 2), torch.optim.Adam(module.parameters()))
    path = checkpoint_path(tmp_path / "a.safetensors")
    tensors = {**state.tensors(), "part.bias": torch.zeros(1)}
    write_checkpoint(path, tensors, '{"step": 7}')
    with pytest.raises(LiveHandError, match=r"size mismatch(.|\n)*delete it to start again"):
        load_checkpoint(path, state, "run")
