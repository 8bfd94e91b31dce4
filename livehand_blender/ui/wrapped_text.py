"""Text that is wrapped to a panel's width."""

from __future__ import annotations

import textwrap

import bpy

_CHARACTER_PX = 7  # approximate width in Blender's interface font at its usual size
_MIN_CHARACTERS = 20


def draw_wrapped(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str = "NONE") -> None:
    """Draw labels that fit the region's width; the first has the icon."""
    width_px = context.region.width if context.region else 0
    scale = context.preferences.system.ui_scale or 1  # 0 without a window
    characters = max(_MIN_CHARACTERS, int(width_px / (_CHARACTER_PX * scale)))
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, characters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")
