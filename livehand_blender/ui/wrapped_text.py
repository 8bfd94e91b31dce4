"""Text that is wrapped to a panel's width."""

from __future__ import annotations

import textwrap

import bpy

# Approximate widths: of a character in Blender's interface font, of a panel's margins with the tabs, of an icon.
_CHARACTER_PX, _MARGINS_PX, _ICON_PX = 6, 45, 20
_MIN_CHARACTERS = 30


def draw_wrapped(context: bpy.types.Context, layout: bpy.types.UILayout, text: str, icon: str = "NONE") -> None:
    """Draw labels that fit the region's width; the first has the icon."""
    width_px = context.region.width if context.region else 0
    scale = context.preferences.system.ui_scale or 1  # 0 without a window
    content_px = width_px / scale - _MARGINS_PX - (_ICON_PX if icon != "NONE" else 0)
    characters = max(_MIN_CHARACTERS, int(content_px / _CHARACTER_PX))
    column = layout.column(align=True)
    for number, line in enumerate(textwrap.wrap(text, characters)):
        column.label(text=line, icon=icon if number == 0 else "BLANK1" if icon != "NONE" else "NONE")
