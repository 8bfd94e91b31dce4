"""The folder of Python packages that is the extension's own: Blender removes it with the extension."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import bpy

from ...backend.system.package_install import install_command
from ...backend.system.packages import missing_requirements
from ...backend.system.shells import command_line, shells_of

EXTENSION = (__package__ or "").removesuffix(".livehand_blender.render")
"""`bl_ext.<repository>.livehand`; `livehand` for a pip package."""
_INDEX_FILE = Path(__file__).parents[2] / "package_index.txt"


def packages_folder() -> Path | None:
    """Return the folder, which may not exist yet; None: LiveHand is a pip package, and the packages are Python's own.

    It is named after Python's version: Blender copies a user's extensions from one of its versions to the next.
    """
    if not EXTENSION.startswith("bl_ext."):
        return None
    version = f"py{sys.version_info.major}{sys.version_info.minor}"
    return Path(bpy.utils.extension_path_user(EXTENSION, path="packages")) / version


def use_packages() -> None:
    """Let Python find what is in the folder, after all that Blender brings."""
    folder = packages_folder()
    if folder is not None and folder.is_dir() and str(folder) not in sys.path:
        sys.path.append(str(folder))
        importlib.invalidate_caches()


def forget_packages() -> None:
    """Undo `use_packages`; what is imported stays so."""
    folder = packages_folder()
    if folder is not None and str(folder) in sys.path:
        sys.path.remove(str(folder))


def released_index() -> str:
    """Return the address of PyTorch's index for CPUs that this release was made with; empty if with none."""
    return _INDEX_FILE.read_text(encoding="utf-8").strip() if _INDEX_FILE.is_file() else ""


def package_index(context: bpy.types.Context) -> str:
    """Return the index of packages that pip asks beside its own; empty if there is none."""
    addon = context.preferences.addons.get(EXTENSION)
    return addon.preferences.package_index.strip() if addon and addon.preferences else released_index()


def missing_packages(error: ImportError) -> str:
    """Say what is missing: in Blender's window, which has a button, and to who reads a farm's log."""
    missing = missing_requirements()
    if not missing:
        return f"the renderer cannot be imported ({error}); reinstall the package at fault and restart Blender"
    names = ", ".join(requirement.module for requirement in missing)
    reason = f"rendering needs Python packages that Blender's Python lacks: {names}"
    if not bpy.app.background:
        return f"{reason}; press Install Packages at the top of the LiveHand tab"
    line = command_line(install_command(missing, packages_folder(), released_index()), shells_of()[0])
    return f"{reason}; install them with: {line}"
