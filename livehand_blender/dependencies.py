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
    Requirement("jaxtyping", "jaxtyping>=0.2.34"),
    Requirement("trimesh", "trimesh>=4.4"),
    Requirement("xatlas", "xatlas>=0.0.9"),
    Requirement("PIL", "pillow>=10"),
    Requirement("tqdm", "tqdm>=4.66"),
)


def is_installed(requirement: Requirement) -> bool:
    """Whether Blender's Python finds the package; it is not imported."""
    return importlib.util.find_spec(requirement.module) is not None


def missing_requirements() -> tuple[Requirement, ...]:
    """What has to be installed before a hand can be rendered."""
    return tuple(requirement for requirement in REQUIREMENTS if not is_installed(requirement))


def install_command(requirements: tuple[Requirement, ...]) -> str:
    """The shell command that puts packages where Blender looks for them at its next start.

    The target is the user's `scripts/modules` folder, which Blender puts on the path if it exists. That folder comes
    first on the path, so numpy is held at Blender's own version: another one would break Blender's add-ons.
    """
    target = bpy.utils.user_resource("SCRIPTS", path="modules")
    wanted = [requirement.pip for requirement in requirements] + [f"numpy=={metadata.version('numpy')}"]
    quoted = " ".join(f'"{name}"' for name in wanted)
    return f'"{sys.executable}" -m pip install --target "{target}" {quoted}'
