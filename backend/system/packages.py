"""Python packages that rendering requires: which are missing, and what installs them.

Nothing is imported or installed here: the user runs the command.
"""

from __future__ import annotations

import ctypes
import importlib.util
import os
import sys
from importlib import metadata
from pathlib import Path
from typing import NamedTuple


class Requirement(NamedTuple):
    """A module's name, and its requirement for pip."""

    module: str
    pip: str


REQUIREMENTS = (
    Requirement("torch", "torch>=2.6,<2.14"),
    Requirement("safetensors", "safetensors>=0.4"),
    Requirement("numba", "numba>=0.60"),  # rendering works without, many times slower on a CPU
    Requirement("jaxtyping", "jaxtyping>=0.2.34"),
    Requirement("trimesh", "trimesh>=4.4"),
    Requirement("xatlas", "xatlas>=0.0.9"),
    Requirement("PIL", "pillow>=10.1"),
    Requirement("tqdm", "tqdm>=4.66"),
    Requirement("ijson", "ijson>=3.2"),  # pose files of data sets
)


def is_installed(requirement: Requirement) -> bool:
    """Return whether this Python finds the package; it is not imported."""
    return importlib.util.find_spec(requirement.module) is not None


def missing_requirements() -> tuple[Requirement, ...]:
    """List what has to be installed before a hand can be rendered."""
    return tuple(requirement for requirement in REQUIREMENTS if not is_installed(requirement))


def install_command(requirements: tuple[Requirement, ...], target: Path | None = None) -> str:
    """Return the shell command that installs packages for this Python.

    Args:
        requirements: what to install.
        target: a folder on this Python's path to install into; None: its own site-packages.

    A `pip.py` in the current folder is not run (-P). numpy is held at the version in use: a newer one in `target` would
    come first and break Blender's own add-ons.
    """
    wanted = [requirement.pip for requirement in requirements] + [f"numpy=={metadata.version('numpy')}"]
    quoted = " ".join(f'"{name}"' for name in wanted)
    option = f'--target "{target}" ' if target else ""
    return f'"{sys.executable}" -P -m pip install {option}{quoted}'


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
