"""Python packages that LiveHand requires, and which of them are missing; nothing is imported or installed here."""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
import sysconfig
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple


class PinnedWheel(NamedTuple):
    """The file of a pinned package for a system, as `sysconfig.get_platform` names it; its hash and its megabytes."""

    system: str
    sha256: str
    megabytes: int


class Requirement(NamedTuple):
    """A module's name, its requirement for pip, and the megabytes that pip downloads for it on Linux.

    Where it has `wheels`, pip takes one of those and nothing else, by its hash; and nothing that it needs.
    """

    module: str
    pip: str
    megabytes: int = 1
    wheels: tuple[PinnedWheel, ...] = ()


REQUIREMENTS = (
    Requirement("torch", "torch>=2.6,<2.14", 203),
    Requirement("safetensors", "safetensors>=0.4"),
    # Kernels use what is numba's own, so newer ones are tried first. Without it a CPU renders many times slower.
    Requirement("numba", "numba>=0.60,<0.69", 82),
    Requirement("jaxtyping", "jaxtyping>=0.2.34"),
    Requirement("trimesh", "trimesh>=4.4"),
    Requirement("xatlas", "xatlas>=0.0.9"),
    Requirement("PIL", "pillow>=10.1", 7),
    Requirement("tqdm", "tqdm>=4.66"),
    Requirement("ijson", "ijson>=3.2"),  # pose files of data sets
)
PICTURES = (Requirement("scipy", "scipy>=1.11", 37), Requirement("cv2", "opencv-python-headless>=4.9,<4.12", 50))
"""What avatars from a film or photographs need beside those."""
CAMERA = (Requirement("av", "av>=14", 36),)
"""What hands that follow a camera need beside those."""
GPU = (
    Requirement(
        "warp",
        "warp-lang==1.19.0",  # as the extra `gpu`; beside numpy, which Blender brings, it needs nothing
        wheels=(
            PinnedWheel("linux-x86_64", "c797f5f4aa9925f676e20dd28e5416fee794499f3f3c0a5b66f2d4dfc2de9e32", 149),
            PinnedWheel("linux-aarch64", "bc1511b8d5d987a69c2b18edbad721a8949b9f3622a91e3f9187a208fa9e3fab", 148),
            PinnedWheel("win-amd64", "bb4865dde4c2ae916d3d2a4e20ed1cd406e1d0a76ae722c3c574a9d43385c4d9", 135),
        ),
    ),
)
"""What whole frames on an NVIDIA GPU need beside those."""

_SLIM_LINUX_TORCH = "torch==2.13.0+cpu"
_WINDOWS_TORCH = "torch>=2.6,<2.13"  # files of 2.13 have longer paths than Windows takes


def pip_requirements(
    requirements: Iterable[Requirement], system: str = sys.platform, has_cpu_index: bool = True
) -> list[str]:
    """Return what pip is asked for.

    Args:
        requirements: wanted.
        system: `sys.platform` of the system that they are for.
        has_cpu_index: pip is given PyTorch's index for CPUs. On Linux, torch of the usual index brings gigabytes of
            CUDA's libraries, which LiveHand has no use for.
    """
    other_torch = {"win32": _WINDOWS_TORCH} | ({"linux": _SLIM_LINUX_TORCH} if has_cpu_index else {})
    return [
        other_torch.get(system, requirement.pip) if requirement.module == "torch" else requirement.pip
        for requirement in requirements
    ]


def is_installed(requirement: Requirement) -> bool:
    """Return whether this Python finds the package; it is not imported."""
    return importlib.util.find_spec(requirement.module) is not None


def wheel_here(requirement: Requirement) -> PinnedWheel | None:
    """Return a pinned package's file for this system; None: it has none, or is not pinned."""
    return next((wheel for wheel in requirement.wheels if wheel.system == sysconfig.get_platform()), None)


def missing_of(requirements: Iterable[Requirement]) -> tuple[Requirement, ...]:
    """List those that are not installed."""
    return tuple(requirement for requirement in requirements if not is_installed(requirement))


def missing_requirements() -> tuple[Requirement, ...]:
    """List what has to be installed before a hand can be rendered."""
    return missing_of(REQUIREMENTS)


# Blender's window waits for the lock. Reading 400 MB from a slow disk takes ten seconds.
_NAMES = ("libtorch_global_deps", "libtorch")  # in torch's own order; neither needs Python
_SUFFIX = ".dylib" if sys.platform == "darwin" else ".so"


def load_torch_libraries() -> None:
    """Load the libraries, after which `import torch` finds them loaded; other threads go on meanwhile.

    Does nothing where torch is missing, imported already, or installed in another way. On Windows, torch itself lets
    go of the lock.
    """
    if "torch" in sys.modules or os.name != "posix":
        return
    found = importlib.util.find_spec("torch")
    if found is None or found.origin is None:
        return
    load = ctypes.CDLL(None).dlopen  # called by ctypes, which lets go of the lock; `ctypes.CDLL(path)` does not
    load.argtypes, load.restype = (ctypes.c_char_p, ctypes.c_int), ctypes.c_void_p
    for name, flags in zip(_NAMES, (os.RTLD_GLOBAL, os.RTLD_LOCAL), strict=True):
        path = Path(found.origin).parent / "lib" / f"{name}{_SUFFIX}"
        if path.is_file():
            load(os.fsencode(path), flags | os.RTLD_LAZY)
