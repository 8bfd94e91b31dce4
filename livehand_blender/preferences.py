"""Preferences of the add-on: which Python packages are missing, and how to install them."""

import bpy

from .dependencies import REQUIREMENTS, is_installed

# `bl_ext.<repository>.livehand` as an extension, `livehand` as a pip package.
_ADDON = (__package__ or "").rpartition(".")[0]


class LIVEHAND_AP_preferences(bpy.types.AddonPreferences):
    """Shown under the add-on's name in Blender's preferences."""

    bl_idname = _ADDON

    def draw(self, context):
        """One line per package, then what to do."""
        column = self.layout.column(align=True)
        installed = {requirement.module: is_installed(requirement) for requirement in REQUIREMENTS}
        for module, found in installed.items():
            column.label(text=f"{module}: {'found' if found else 'missing'}", icon="CHECKMARK" if found else "ERROR")
        draw_install_help(self.layout, missing=not all(installed.values()))


CLASSES = (LIVEHAND_AP_preferences,)


def draw_install_help(layout: bpy.types.UILayout, missing: bool) -> None:
    """How to install what is missing; nothing where all is there."""
    if not missing:
        return
    column = layout.column(align=True)
    column.label(text="Rendering needs more Python packages:", icon="INFO")
    column.label(text="run the copied command in a terminal,")
    column.label(text="then restart Blender.")
    column.operator("livehand.copy_install_command", icon="COPYDOWN")
