"""Chooses the backend that computes the costly stages on a device, and compiles its kernels ahead.

They are compiled by small pictures that need every one of them; Blender does so in a process of its own.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import torch

from ..avatars.library import shipped_avatar_path
from ..compute.cuda import CudaBackend
from ..compute.reference import ReferenceBackend
from ..system.child_job import JobProgress, Report, run_job
from ..system.processes import lower_priority

if TYPE_CHECKING:
    from ..hand.model import HandModel
    from ..records.shot import Shot

LOGGER = logging.getLogger(__name__)
_SIDE_PX = 64
_LOOK_S = 0.5


def choose_backend(device: torch.device) -> ReferenceBackend:
    """Choose numba on the CPU, if it is installed and works; elsewhere torch, with shadow maps by numba if it can."""
    if not has_numba():
        return ReferenceBackend()
    from ..compute.cpu.backend import NumbaBackend

    return NumbaBackend() if device.type == "cpu" else CudaBackend(NumbaBackend())


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


class Prepared(NamedTuple):
    """How long it took, s, and the folder that keeps the kernels; None: no folder takes them."""

    seconds: float
    folder: Path | None


def prepare_kernels(avatar_path: Path) -> Prepared:
    """Compile the kernels that render this avatar of the built-in hand; numba must be there.

    Raises:
        LiveHandError: the avatar cannot be read.
    """
    from ..avatars.file import load_avatar
    from ..compute.kernels.cache_folder import mark_prepared
    from ..hand.model_file import load_default_hand
    from .renderer import Renderer

    began, avatar, hand = time.perf_counter(), load_avatar(avatar_path), load_default_hand()
    for precision in ("fp32", "bf16"):
        renderer = Renderer(avatar, hand, "cpu", precision)
        for shot in _shots(hand):
            renderer.render(shot)
    folder = kernel_cache()
    if folder is not None:
        mark_prepared(folder)
    return Prepared(time.perf_counter() - began, folder)


def _shots(hand: HandModel) -> list[Shot]:
    """Make small pictures that need every kernel: in the avatar's own light, and between lamp, sky and occluder."""
    import numpy as np

    from ..hand.lbs import posed_vertices
    from ..records.camera import Camera, look_at
    from ..records.light import Light
    from ..records.shot import HandPose, Shot
    from .studio_light import studio_light

    pose = HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3), hand.side)
    vertices = posed_vertices(hand, pose)
    centre, size_m = vertices.mean(0), float(np.ptp(vertices, axis=0).max())
    K = np.array([[_SIDE_PX, 0, _SIDE_PX / 2], [0, _SIDE_PX, _SIDE_PX / 2], [0, 0, 1.0]])
    cam2world = look_at(centre + size_m * np.array([0, 1.5, 0.2]), centre, np.array([0, 0, 1.0]))
    shot = Shot(pose, vertices, Camera(K, cam2world, (_SIDE_PX, _SIDE_PX)))
    beside = centre + size_m * np.array([[2.0, 0, 0], [2, 0.1, 0], [2, 0, 0.1]])
    studio = studio_light()
    occluded = Light(studio.lamps, studio.sky, occluders=beside[None].astype(np.float32))
    return [shot, replace(shot, light=studio), replace(shot, light=occluded)]


def run() -> None:
    """Compile the kernels in the process of a job."""
    run_job(_prepared, "the kernels need more memory than is free; close other programs")


def _prepared(_request: None, report: Report) -> Mapping[str, Any]:
    lower_priority()
    threading.Thread(target=_count, args=(report,), name="livehand count", daemon=True).start()
    return {"seconds": prepare_kernels(shipped_avatar_path()).seconds}


def _count(report: Report) -> None:
    """Report how many kernels are compiled, until the process ends."""
    from ..compute.cpu import backend  # noqa: F401, which imports all kernels
    from ..compute.kernels.compiled import kernel_counts

    while True:
        compiled, every = kernel_counts()
        report(JobProgress(f"{compiled} of {every}", compiled / max(every, 1)))
        time.sleep(_LOOK_S)
