"""Which backend is chosen, also where numba is missing or broken."""

import logging
import sys

import pytest
import torch
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.cuda import CudaBackend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.render import backends
from livehand.backend.render.backends import choose_backend, has_numba

CPU = torch.device("cpu")


@pytest.fixture(autouse=True)
def search_again():
    """numba is searched once per process."""
    has_numba.cache_clear()
    yield
    has_numba.cache_clear()


def test_a_missing_numba_is_no_error(monkeypatch, caplog):
    monkeypatch.setitem(sys.modules, "numba", None)
    assert type(choose_backend(CPU)) is ReferenceBackend
    assert not caplog.records


def test_a_numba_that_breaks_on_import_gives_one_warning(monkeypatch, caplog):
    def refuse(name):
        raise ImportError("Numba needs NumPy 2.3 or less. Got NumPy 9.0.")

    monkeypatch.setattr(backends, "import_module", refuse)
    with caplog.at_level(logging.WARNING):
        assert all(type(choose_backend(CPU)) is ReferenceBackend for _ in range(3))
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "NumPy 9.0" in caplog.text


def test_numba_is_for_the_cpu():
    assert isinstance(choose_backend(CPU), NumbaBackend)
    assert isinstance(choose_backend(torch.device("cuda")), CudaBackend)


def test_a_gpu_without_numba_is_torchs_alone(monkeypatch):
    monkeypatch.setitem(sys.modules, "numba", None)
    assert type(choose_backend(torch.device("cuda"))) is ReferenceBackend
