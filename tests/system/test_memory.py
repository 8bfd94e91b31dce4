"""Errors of numpy and torch that mean that memory is short, and no others."""

import argparse

import numpy as np
import pytest
import torch
from livehand.backend.system.command import FAILED, Command, run_commands
from livehand.backend.system.memory import memory_message

EXABYTES = 1 << 60
CUDA = "CUDA out of memory. Tried to allocate 2.50 GiB. GPU 0 has a total capacity of 10.00 GiB"


def error_of(ask):
    try:
        ask()
    except (MemoryError, RuntimeError) as error:
        return error
    raise AssertionError("there was room")


@pytest.mark.parametrize(
    ("ask", "reported"),
    [
        (lambda: np.empty((1 << 28, 1 << 20), np.float32), "1.05e+06 GB of memory more must be free"),
        (lambda: torch.empty(1 << 50, dtype=torch.float32), "4.19e+06 GB of memory more must be free"),
        (lambda: bytearray(EXABYTES), "more memory must be free than there is"),
    ],
)
def test_the_gigabytes_are_told(ask, reported):
    message = memory_message(error_of(ask))
    assert message.startswith(reported)
    assert message.endswith("make the image smaller or render fewer at once, or close other programs")


def test_a_gpus_memory_is_its_own():
    assert memory_message(torch.OutOfMemoryError(CUDA)).startswith("2.5 GB of the GPU's memory more must be free")


@pytest.mark.parametrize("error", [RuntimeError("shapes differ"), ValueError("out of memory"), KeyError(5)])
def test_other_errors_stay(error):
    assert memory_message(error) is None


@pytest.mark.parametrize("module", [np, torch])
def test_a_command_ends_with_the_sentence(module, capsys):
    def run(args: argparse.Namespace):
        module.empty((1 << 28, 1 << 20))

    assert run_commands("x", "", {"y": Command("y", "", lambda parser: None, run)}, ["y"]) == FAILED
    err = capsys.readouterr().err
    assert err.startswith("x y: ")
    assert "GB of memory more must be free" in err
    assert err.count("\n") == 1


def test_a_command_with_another_error_shows_it():
    def run(args: argparse.Namespace):
        raise RuntimeError("shapes differ")

    with pytest.raises(RuntimeError, match="shapes differ"):
        run_commands("x", "", {"y": Command("y", "", lambda parser: None, run)}, ["y"])
