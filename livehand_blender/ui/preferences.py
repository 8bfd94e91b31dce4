"""Preferences of the add-on: a folder of avatars, where packages come from, and which are installed."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty

from ...backend.system.packages import REQUIREMENTS, is_installed
from ...backend.system.shells import shells_of
from ..render.package_folder import released_index
from .packages import draw_gpu, draw_install

# `bl_ext.<repository>.livehand` for an extension, `livehand` for a pip package.
_ADDON = (__package__ or "").removesuffix(".livehand_blender.ui")


class LIVEHAND_AP_preferences(bpy.types.AddonPreferences):
    """Shown under the add-on's name in Blender's preferences."""

    bl_idname = _ADDON

    avatar_folder: StringProperty(
        name="Avatar Folder",
        description="Folder of your own avatars (.safetensors), which Choose Avatar lists beside LiveHand's",
        subtype="DIR_PATH",
    )
    package_index: StringProperty(
        name="Package Index",
        description="Address that pip asks beside its own: PyTorch's index for CPUs saves gigabytes of CUDA on Linux",
        default=released_index(),
    )

    def draw(self, context):
        """Draw the folder, the missing packages, how to install them here or in a terminal, and GPU rendering."""
        self.layout.prop(self, "avatar_folder")
        missing = [requirement.module for requirement in REQUIREMENTS if not is_installed(requirement)]
        if not missing:
            self.layout.label(text="All Python packages are installed", icon="CHECKMARK")
            draw_gpu(self.layout, context)
            return
        self.layout.prop(self, "package_index")
        column = self.layout.column(align=True)
        column.label(text=f"Missing: {', '.join(missing)}", icon="ERROR")
        draw_install(column, context)
        for shell in shells_of():
            text = f"Copy Command for {shell.value}"
            column.operator("livehand.copy_install_command", text=text, icon="COPYDOWN").shell = shell.name


CLASSES = (LIVEHAND_AP_preferences,)


def avatar_folder(context: bpy.types.Context) -> Path | None:
    """Return the user's folder of avatars; None if none is set, or if LiveHand is not installed as an add-on."""
    addon = context.preferences.addons.get(_ADDON)
    chosen = addon.preferences.avatar_folder if addon and addon.preferences else ""
    return Path(bpy.path.abspath(chosen)) if chosen else None


def library_folder(context: bpy.types.Context) -> Path:
    """Return the folder for avatars that are made here: the user's own of the preferences, or one of Blender's data."""
    folder = avatar_folder(context)
    if folder is None:
        folder = Path(bpy.utils.user_resource("DATAFILES", path="livehand/avatars", create=True))
    folder.mkdir(parents=True, exist_ok=True)
    return folder
