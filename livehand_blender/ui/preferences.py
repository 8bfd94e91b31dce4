"""Preferences of the add-on: a folder of avatars, and which Python packages are installed."""

from __future__ import annotations

from pathlib import Path

import bpy
from bpy.props import StringProperty

from ...backend.system.packages import REQUIREMENTS, is_installed

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

    def draw(self, context):
        """Draw the folder, one line per package, and how to install missing ones."""
        self.layout.prop(self, "avatar_folder")
        column = self.layout.column(align=True)
        installed = {requirement.module: is_installed(requirement) for requirement in REQUIREMENTS}
        for module, found in installed.items():
            column.label(text=f"{module}: {'found' if found else 'missing'}", icon="CHECKMARK" if found else "ERROR")
        draw_install_help(self.layout, missing=not all(installed.values()))


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


def draw_install_help(layout: bpy.types.UILayout, missing: bool) -> None:
    """Draw how to install missing packages; draws nothing if none is missing."""
    if not missing:
        return
    column = layout.column(align=True)
    column.label(text="Python packages are missing:", icon="INFO")
    column.label(text="run the copied command in a")
    column.label(text="terminal, then restart Blender.")
    column.operator("livehand.copy_install_command", icon="COPYDOWN")
