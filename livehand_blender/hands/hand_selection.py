"""A click on a hand's mesh selects its armature, which poses and carries it, unless the mesh is edited itself."""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..scene.handlers import add_handlers, remove_handlers


def pass_selection_on(layer: bpy.types.ViewLayer) -> None:
    """Select the armatures of the selected hands' meshes in place of these."""
    for mesh in [thing for thing in layer.objects.selected if _passes_on(thing)]:
        armature = mesh.find_armature()
        if armature is None or armature.name not in layer.objects or not armature.visible_get(view_layer=layer):
            continue
        is_active = layer.objects.active == mesh
        mesh.select_set(False, view_layer=layer)
        armature.select_set(True, view_layer=layer)
        if is_active:
            layer.objects.active = armature


def _passes_on(thing: bpy.types.Object) -> bool:
    return thing.livehand.is_skin and not thing.livehand.mesh_selectable and thing.mode == "OBJECT"


@persistent
def _look(*_) -> None:
    """Pass the selection on after each change of the file, of which a selection is one."""
    if bpy.context.view_layer is not None:
        pass_selection_on(bpy.context.view_layer)


_WATCHED = (("depsgraph_update_post", _look),)


def watch_selection() -> None:
    """Pass the selection of meshes on from now on."""
    add_handlers(_WATCHED)


def stop_watching() -> None:
    """Undo `watch_selection`."""
    remove_handlers(_WATCHED)
