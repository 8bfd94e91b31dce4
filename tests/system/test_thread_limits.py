"""Waiting threads give up their core, unless the user has said otherwise; and torch's library reads what is set."""

import os
import subprocess
import sys

import pytest
import torch
from livehand.backend.system.thread_limits import limit_spinning, thread_limit

NAMES = ("GOMP_SPINCOUNT", "KMP_BLOCKTIME")


def test_both_libraries_are_told(monkeypatch):
    for name in NAMES:
        monkeypatch.delenv(name, raising=False)
    limit_spinning()
    assert [os.environ[name] for name in NAMES] == ["0", "0"]


def test_what_the_user_has_set_stays(monkeypatch):
    for name in NAMES:
        monkeypatch.setenv(name, "7")
    limit_spinning()
    assert [os.environ[name] for name in NAMES] == ["7", "7"]


def test_commands_set_it_before_torch_comes():
    """`--help` of the program leaves it set, and torch is not loaded yet."""
    code = (
        "import os, sys; from livehand.backend.system.command import run_commands;"
        "run_commands('x', '', {}, ['--help']);"
        "print('torch' in sys.modules, os.environ.get('GOMP_SPINCOUNT'))"
    )
    environment = {name: value for name, value in os.environ.items() if name not in NAMES}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.splitlines()[-1] == "False 0"


def test_threads_are_few_within_and_as_before_after_an_error():
    usual = torch.get_num_threads()

    def fail():
        with thread_limit(usual + 2):
            assert torch.get_num_threads() == usual + 2
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert torch.get_num_threads() == usual
