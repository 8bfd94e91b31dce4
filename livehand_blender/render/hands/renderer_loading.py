"""Loads an avatar's renderer in Blender, and says how to install packages that Blender's Python lacks."""

from __future__ import annotations

from pathlib import Path

import bpy

from ....backend.hand.model import HandModel
from ....backend.records.errors import LiveHandError
from ....backend.render.frame_task import HandRenderer
from ....backend.render.session import Device, load_renderer
from ....backend.system.dependencies import install_command, missing_requirements


def load_renderer_in_blender(avatar_path: Path, hand: HandModel, device: Device) -> HandRenderer:
    """Load the backend's renderer of one avatar.

    Raises:
        LiveHandError: a package is missing, or the avatar cannot be read or belongs to another hand model.
    """
    try:
        return load_renderer(avatar_path, hand, device)
    except ImportError as error:
        raise LiveHandError(_missing_packages(error)) from error


def packages_folder() -> Path | None:
    """The folder in which the Blender program looks for the user's packages; None if Blender is a Python module.

    When it starts, the program adds the user's `scripts/modules` folder to the path, if the folder exists.
    """
    if not bpy.app.binary_path:  # bpy.app.module does not exist in 4.2
        return None
    return Path(bpy.utils.user_resource("SCRIPTS", path="modules"))


def _missing_packages(error: ImportError) -> str:
    missing = missing_requirements()
    if not missing:
        return f"the renderer cannot be imported ({error}); reinstall the package at fault and restart Blender"
    names = ", ".join(requirement.module for requirement in missing)
    return (
        f"rendering needs Python packages that Blender's Python lacks: {names}; install them with: "
        f"{install_command(missing, packages_folder())} and restart Blender"
    )
