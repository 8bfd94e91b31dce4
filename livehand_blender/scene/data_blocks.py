"""The data-blocks of the open file."""

from __future__ import annotations

import bpy


def all_data() -> set[bpy.types.ID]:
    """Each data-block of the open file once; from Blender 5.2 on, `bpy.data` lists them by kind and all together."""
    kinds = [prop.identifier for prop in bpy.data.bl_rna.properties if prop.type == "COLLECTION"]
    return {thing for kind in kinds for thing in getattr(bpy.data, kind)}
