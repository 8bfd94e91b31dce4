"""Chooses the backend that computes the costly stages on a device."""

from __future__ import annotations

import logging
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import torch

from ..compute.cuda import CudaBackend
from ..compute.reference import ReferenceBackend

LOGGER = logging.getLogger(__name__)


def choose_backend(device: torch.device) -> ReferenceBackend:
    """Choose numba on the CPU and Warp on an NVIDIA GPU, if they are installed and work; else torch.

    Beside a GPU without Warp, numba makes the shadow maps if it can.
    """
    if device.type == "cuda" and has_warp():
        from ..compute.gpu.backend import WarpBackend

        return WarpBackend()
    if not has_numba():
        return ReferenceBackend()
    from ..compute.cpu.backend import NumbaBackend

    return NumbaBackend() if device.type == "cpu" else CudaBackend(NumbaBackend())


def gpu_renderer() -> ReferenceBackend | None:
    """Return what renders on an NVIDIA GPU whatever torch there is; None: Warp is not installed or does not work."""
    if not (has_numba() and has_warp()):
        return None
    from ..compute.cpu.frames_on_gpu import FramesOnGpu

    return FramesOnGpu("cuda:0")


@cache
def has_numba() -> bool:
    """Return whether numba can be imported. It refuses a numpy newer than it knows; torch alone still renders then."""
    try:
        import_module("numba")
    except ModuleNotFoundError:
        return False
    except Exception as error:  # whatever is broken in numba, torch can still render
        LOGGER.warning("numba is installed but fails (%s); rendering continues without it, many times slower", error)
        return False
    return True


def has_warp() -> bool:
    """Return whether Warp is installed (the extra `gpu`) and has computed a known value on the GPU.

    Where it cannot, a warning says why: torch still renders there, slower. Blender may install it at any time.
    """
    return find_spec("warp") is not None and _warp_works()


@cache
def _warp_works() -> bool:
    try:
        from ..compute.gpu.backend import check_gpu

        check_gpu()
    except Exception as error:  # whatever is broken in Warp or the driver, torch can still render
        LOGGER.warning("warp-lang is installed but not used (%s); rendering continues without it, slower", error)
        return False
    return True


def kernel_cache() -> Path | None:
    """Return the folder that keeps compiled kernels; None: no folder takes them."""
    from ..compute.kernels.compiled import kernel_folder

    return kernel_folder()


def has_int8_kernels() -> bool:
    """Return whether networks in reduced precision multiply int8 on this processor."""
    if not has_numba():
        return False
    from ..compute.kernels.vectors import has_int8_products

    return has_int8_products()
