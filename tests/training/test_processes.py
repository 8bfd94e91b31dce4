"""Several processes give the result of one process with the same batch."""

import json
import subprocess
import sys

import pytest
import torch
import torch.distributed as dist
from livehand.backend.avatars.file import load_avatar
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.command import run_commands
from livehand.backend.training.config import ReportConfig, TrainConfig
from livehand.backend.training.loop import Training, train
from livehand.backend.training.processes import ComputeSetup, Processes, process_device
from livehand.backend.training.schedule import Clock
from livehand.livehand_blender.cli import COMMANDS

CPU = torch.device("cpu")


@pytest.mark.nightly
def test_two_processes_of_torchrun_give_the_result_of_one(painted_capture, tmp_path, capsys, weights_of, log_of):
    options = ["--steps", "5", "--batch", "2", "--perceptual", "0", "--device", "cpu", "--precision", "fp32", "--json"]
    options += ["--preview-minutes", "0"]

    def arguments(name):
        return ["train", str(painted_capture.folder), "-o", str(tmp_path / f"{name}.safetensors"), *options]

    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]
    command = [*launch, "-m", "livehand.livehand_blender", *arguments("two")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert done.returncode == 0, done.stderr
    assert run_commands("livehand", "", COMMANDS, arguments("one")) == 0
    results = [json.loads(line) for line in (done.stdout + capsys.readouterr().out).splitlines()]
    assert [result["steps"] for result in results] == [5, 5]  # the second process prints nothing
    one, two = (load_avatar(tmp_path / f"{name}.safetensors") for name in ("one", "two"))
    for key, value in weights_of(two).items():
        torch.testing.assert_close(value, weights_of(one)[key], atol=1e-4, rtol=2e-3)
    losses = [
        [entry["loss/total"] for entry in log_of(tmp_path / f"{name}.safetensors") if "loss/total" in entry]
        for name in ("one", "two")
    ]
    assert losses[0] == pytest.approx(losses[1], rel=1e-4)


def test_shares_are_disjoint_and_complete():
    shares = [Processes(rank, 3).share(range(6)) for rank in range(3)]
    assert [list(share) for share in shares] == [[0, 3], [1, 4], [2, 5]]
    assert [Processes(rank, 3).is_first for rank in range(3)] == [True, False, False]


def test_gradients_are_summed_and_unused_parameters_keep_none(monkeypatch):
    """Two processes, one after the other: the values of the second are added to those of the first."""
    used, half_used, unused = (torch.nn.Parameter(torch.ones(2, 2)) for _ in range(3))
    sent = []

    def all_reduce(values):
        sent.append(values.clone())
        values.copy_(sum(sent))

    monkeypatch.setattr(dist, "all_reduce", all_reduce)
    used.grad, half_used.grad = torch.full((2, 2), 1.0), None
    Processes(0, 2).sum_gradients([used, half_used, unused])
    used.grad, half_used.grad = torch.full((2, 2), 4.0), torch.full((2, 2), 3.0)
    Processes(1, 2).sum_gradients([used, half_used, unused])
    assert torch.equal(used.grad, torch.full((2, 2), 5.0))
    assert torch.equal(half_used.grad, torch.full((2, 2), 3.0))
    assert unused.grad is None


def test_all_processes_use_the_clock_of_the_first(monkeypatch, setup, tmp_path):
    """A second process whose own clock stands still ends when the budget is spent on the clock of the first."""
    seconds = iter(range(0, 100, 7))

    def broadcast(values, source):
        assert source == 0
        values.fill_(next(seconds))

    monkeypatch.setattr(dist, "broadcast", broadcast)
    monkeypatch.setattr(dist, "all_reduce", lambda values: None)
    config, compute = TrainConfig(minutes=0.5, batch=2), ComputeSetup(CPU, "fp32", Processes(1, 2))
    training = Training(setup, config, tmp_path / "a.safetensors", compute, clock=Clock(now=lambda: 0.0))
    progress = training.run(ReportConfig()).progress
    assert (progress.step, progress.seconds) == (6, 35)
    assert not list(tmp_path.iterdir())  # nor does it write anything


def test_a_single_process_does_not_communicate(monkeypatch):
    for name in ("all_reduce", "broadcast"):
        monkeypatch.setattr(dist, name, pytest.fail)
    parameter = torch.nn.Parameter(torch.ones(2))
    Processes().sum_gradients([parameter])
    assert parameter.grad is None
    assert torch.equal(Processes().sum(torch.arange(3.0)), torch.arange(3.0))
    assert Processes().from_first(2.5, CPU) == 2.5


def test_a_batch_that_cannot_be_shared_is_refused(setup, tmp_path):
    compute = ComputeSetup(CPU, "fp32", Processes(0, 2))
    with pytest.raises(LiveHandError, match="shared equally by 2 processes, got 3; give --batch 2 or a multiple"):
        train(setup, TrainConfig(batch=3), tmp_path / "a.safetensors", compute, ReportConfig())


def test_every_process_of_a_machine_has_its_own_gpu(monkeypatch):
    chosen = []
    monkeypatch.setenv("LOCAL_RANK", "3")
    assert process_device("cpu") == CPU
    monkeypatch.setattr(torch.cuda, "is_available", lambda: True)
    monkeypatch.setattr(torch.cuda, "set_device", chosen.append)
    assert process_device("auto") == torch.device("cuda", 3)
    assert chosen == [torch.device("cuda", 3)]
    monkeypatch.delenv("LOCAL_RANK")
    assert process_device("cuda") == torch.device("cuda")
