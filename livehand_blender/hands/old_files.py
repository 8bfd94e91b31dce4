"""Old files open as they were: settings that they lack get the value that stands for their time.

Files of version 0, saved before hands could be lit, keep the light of the avatars' captures; those before version 2
keep 16 blur samples; those before version 3 hid their hands' meshes from clicks.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..rig.hand import all_hands
from ..scene.handlers import add_handlers, remove_handlers

_VERSION = 3


@persistent
def _stamp(*_) -> None:
    """Before a file is saved."""
    for scene in _local_scenes():
        if scene.livehand.file_version != _VERSION:
            scene.livehand.file_version = _VERSION


@persistent
def _update(*_) -> None:
    """After a file was opened; a scene without hands has nothing to keep."""
    for scene in _local_scenes() if bpy.data.filepath else ():
        version = scene.livehand.file_version
        if version < _VERSION and all_hands(scene):
            if version == 0:
                scene.livehand.light = "CAPTURE"
            if version < 2 and not scene.livehand.is_property_set("blur_samples"):
                scene.livehand.blur_samples = 16
            _let_clicks_through(scene)


def _let_clicks_through(scene: bpy.types.Scene) -> None:
    """Meshes that could be selected were set so by the user."""
    for mesh in scene.objects:
        if mesh.livehand.is_skin and mesh.library is None and mesh.override_library is None:
            mesh.livehand.mesh_selectable = not mesh.hide_select
            mesh.hide_select = False


def _local_scenes() -> list[bpy.types.Scene]:
    return [scene for scene in bpy.data.scenes if scene.library is None]


_WATCHED = (("save_pre", _stamp), ("load_post", _update))


def watch_files() -> None:
    """Stamp the files that are saved, and update those that are opened."""
    add_handlers(_WATCHED)


def stop_watching() -> None:
    """Undo `watch_files`."""
    remove_handlers(_WATCHED)
