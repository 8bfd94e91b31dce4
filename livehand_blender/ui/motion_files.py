"""Motion files dropped into the 3D view, and the entries in the File menu."""

from __future__ import annotations

import bpy

from ..rig.hand import active_hand

_POSES, _LANDMARKS, _RIGS = ".npz;.npy;.pkl", ".json;.jsonl;.csv", ".bvh;.fbx;.glb;.gltf;.vrm"
PATTERN = ";".join(f"*{suffix}" for suffix in ";".join((_POSES, _LANDMARKS, _RIGS)).split(";"))
"""The file browser's filter."""


class _Drop:
    bl_import_operator = "livehand.import_motion"

    @classmethod
    def poll_drop(cls, context):
        """Enable it in the 3D view if a hand is active."""
        return context.area is not None and context.area.type == "VIEW_3D" and active_hand(context) is not None


class LIVEHAND_FH_poses(_Drop, bpy.types.FileHandler):
    """Pose files dropped into the 3D view."""

    bl_idname = "LIVEHAND_FH_poses"
    bl_label = "Hand Poses"
    bl_file_extensions = _POSES


class LIVEHAND_FH_landmarks(_Drop, bpy.types.FileHandler):
    """Landmarks, and JSON of data sets, dropped into the 3D view."""

    bl_idname = "LIVEHAND_FH_landmarks"
    bl_label = "Hand Landmarks or Poses"
    bl_file_extensions = _LANDMARKS


class LIVEHAND_FH_rigs(_Drop, bpy.types.FileHandler):
    """Animated characters and hands dropped into the 3D view."""

    bl_idname = "LIVEHAND_FH_rigs"
    bl_label = "Hand Motion of a Rig"
    bl_file_extensions = _RIGS


CLASSES = (LIVEHAND_FH_poses, LIVEHAND_FH_landmarks, LIVEHAND_FH_rigs)


def add_to_menus() -> None:
    """Add entries to File > Import and File > Export."""
    bpy.types.TOPBAR_MT_file_import.append(_draw_import)
    bpy.types.TOPBAR_MT_file_export.append(_draw_export)


def remove_from_menus() -> None:
    """Undo `add_to_menus`."""
    bpy.types.TOPBAR_MT_file_export.remove(_draw_export)
    bpy.types.TOPBAR_MT_file_import.remove(_draw_import)


def _draw_import(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("livehand.import_motion", text="LiveHand Motion (.npz, .json, .fbx, ...)")


def _draw_export(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("livehand.export_take", text="LiveHand Motion (.npz, .bvh, .fbx, ...)")
    menu.layout.operator("livehand.export_splats", text="LiveHand Splats (.ply, .glb)")
