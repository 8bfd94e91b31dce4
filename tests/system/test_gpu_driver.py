"""NVIDIA's driver tells its CUDA; without one, or on a Mac, there is none."""

import ctypes
import sys
from types import SimpleNamespace

import pytest
from livehand.backend.system import gpu_driver
from livehand.backend.system.gpu_driver import OLDEST_CUDA, CudaVersion, cuda_of_driver, driver_fault


@pytest.fixture(autouse=True)
def asked_again():
    """The driver is asked once per process."""
    cuda_of_driver.cache_clear()
    yield
    cuda_of_driver.cache_clear()


@pytest.fixture
def driver(monkeypatch):
    """Puts a driver into a system, which says a number and a code; returns the names of what is loaded."""

    def put(system, number, code=0):
        loaded = []

        def say(version):
            version._obj.value = number
            return code

        def load(name):
            loaded.append(name)
            return SimpleNamespace(cuDriverGetVersion=say)

        monkeypatch.setattr(sys, "platform", system)
        monkeypatch.setattr(gpu_driver.ctypes, "CDLL", load)
        return loaded

    return put


@pytest.mark.parametrize(
    ("number", "version"), [(13000, (13, 0)), (12040, (12, 4)), (13020, (13, 2)), (11080, (11, 8))]
)
@pytest.mark.parametrize(("system", "library"), [("linux", "libcuda.so.1"), ("win32", "nvcuda.dll")])
def test_the_driver_is_asked_once_for_its_cuda(driver, system, library, number, version):
    loaded = driver(system, number)
    assert cuda_of_driver() == CudaVersion(*version)
    assert cuda_of_driver() == CudaVersion(*version)
    assert loaded == [library]


def test_a_mac_has_none_and_no_library_is_looked_for(driver):
    loaded = driver("darwin", 13000)
    assert cuda_of_driver() is None
    assert loaded == []


@pytest.mark.parametrize(("number", "code"), [(13000, 34), (0, 0)])  # 34: a library without a driver, for compilers
def test_a_library_that_knows_no_driver_is_none(driver, number, code):
    driver("linux", number, code)
    assert cuda_of_driver() is None


def test_a_missing_library_and_one_without_the_function_are_none(monkeypatch):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(gpu_driver, "_LIBRARIES", {"linux": "libno_such_library_of_livehand.so"})
    assert cuda_of_driver() is None
    cuda_of_driver.cache_clear()
    monkeypatch.setattr(gpu_driver.ctypes, "CDLL", lambda name: ctypes.PyDLL(None))
    assert cuda_of_driver() is None


@pytest.mark.parametrize(
    ("version", "is_usable"), [((11, 8), False), ((12, 9), False), ((13, 0), True), ((14, 0), True)]
)
def test_a_driver_before_the_oldest_major_version_must_be_updated(version, is_usable):
    expected = "" if is_usable else "update the NVIDIA driver (CUDA 13)"
    assert driver_fault(CudaVersion(*version)) == expected


def test_warp_asks_for_the_version_that_the_button_asks_for():
    warp = pytest.importorskip("warp")
    assert warp.get_cuda_toolkit_version()[0] == OLDEST_CUDA
