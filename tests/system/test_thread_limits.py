"""Waiting threads give up their core, unless the user has said otherwise; and torch's library reads what is set."""

import os
import subprocess
import sys

import pytest
import torch
from livehand.backend.system.thread_limits import blas_settings, limit_spinning, thread_limit

BLAS = "OPENBLAS_NUM_THREADS"
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


@pytest.mark.parametrize(("users", "wanted"), [(None, "1"), ("3", "3")])
def test_the_program_tells_numpy_before_it_comes(users, wanted):
    """What numpy's library reads as it is loaded is there; numpy is not loaded before; and children get the same."""
    code = (
        "import sys; from livehand.livehand_blender import __main__ as program; "
        "import os; program.run_process = lambda main: print("
        "'numpy' in sys.modules, os.environ['OPENBLAS_NUM_THREADS']); program.program()"
    )
    environment = {name: value for name, value in os.environ.items() if name != BLAS}
    environment |= {} if users is None else {BLAS: users}
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=True)
    assert done.stdout.split() == ["False", wanted]


@pytest.mark.parametrize(("users", "wanted"), [(None, "1"), ("3", "3")])
def test_jobs_get_the_same(users, wanted, monkeypatch):
    monkeypatch.delenv(BLAS, raising=False)
    if users is not None:
        monkeypatch.setenv(BLAS, users)
    assert blas_settings() == {BLAS: wanted}


def test_threads_are_few_within_and_as_before_after_an_error():
    usual = torch.get_num_threads()

    def fail():
        with thread_limit(usual + 2):
            assert torch.get_num_threads() == usual + 2
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        fail()
    assert torch.get_num_threads() == usual
