"""Which device, and when the kernels are used: also where numba is missing or broken."""

import logging
import sys

import pytest
import torch
from livehand.backend.records.errors import LiveHandError
from livehand.backend.rendering import device
from livehand.backend.rendering.device import has_kernels, has_numba, torch_device


@pytest.fixture(autouse=True)
def ask_again():
    """numba is looked for once a process."""
    has_numba.cache_clear()
    yield
    has_numba.cache_clear()


def test_a_missing_numba_is_no_error(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "numba", None)
    assert not has_kernels(torch.device("cpu"))
    assert not caplog.records


def test_a_numba_that_breaks_on_import_is_told_once_and_done_without(monkeypatch, caplog):
    def refuse(name):
        raise ImportError("Numba needs NumPy 2.3 or less. Got NumPy 9.0.")

    monkeypatch.setattr(device, "import_module", refuse)
    with caplog.at_level(logging.WARNING):
        assert [has_kernels(torch.device("cpu")) for _ in range(3)] == [False] * 3
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "NumPy 9.0" in caplog.text


def test_kernels_are_for_the_cpu():
    pytest.importorskip("numba")
    assert has_kernels(torch.device("cpu"))
    assert not has_kernels(torch.device("cuda"))


def test_a_missing_gpu_is_told():
    if torch.cuda.is_available():
        assert torch_device("auto") == torch_device("cuda") == torch.device("cuda")
    else:
        assert torch_device("auto") == torch.device("cpu")
        with pytest.raises(LiveHandError, match="needs a CUDA GPU"):
            torch_device("cuda")
