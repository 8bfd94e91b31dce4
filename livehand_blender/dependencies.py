"""Python packages that rendering needs: which are missing, and the command that installs them.

Nothing is imported and nothing is installed here: the user runs the command.
"""

from __future__ import annotations

import importlib.util
import sys
from importlib import metadata
from typing import NamedTuple

import bpy


class Requirement(NamedTuple):
    """Name to import, and what to ask pip for."""

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
)


def is_installed(requirement: Requirement) -> bool:
    """Whether Blender's Python finds the package; it is not imported."""
    return importlib.util.find_spec(requirement.module) is not None


def missing_requirements() -> tuple[Requirement, ...]:
    """What has to be installed before a hand can be rendered."""
    return tuple(requirement for requirement in REQUIREMENTS if not is_installed(requirement))


def install_command(requirements: tuple[Requirement, ...]) -> str:
    """The shell command that puts packages where this Blender's Python finds them."""
    wanted = [requirement.pip for requirement in requirements] + [f"numpy=={metadata.version('numpy')}"]
    quoted = " ".join(f'"{name}"' for name in wanted)
    return f'"{sys.executable}" -m pip install {_target()}{quoted}'


def _target() -> str:
    """Pip's --target for the Blender program; nothing where Blender is a module of the user's own Python.

    The program puts the user's `scripts/modules` folder on the path when it starts, if it exists. It comes first, so
    numpy is held at Blender's own version above: another one would break Blender's add-ons.
    """
    if not bpy.app.binary_path:  # bpy.app.module does not exist in 4.2
        return ""
    return f'--target "{bpy.utils.user_resource("SCRIPTS", path="modules")}" '
