"""A hand is copied and deleted as a whole: its mesh goes with its armature, to which selections of it are passed on.

A handler sees that the number of objects has changed. In Blender's window the change follows when the running operator
has come to an end; without a window there is no event loop, and it follows at once.
"""

from __future__ import annotations

import bpy
from bpy.app.handlers import persistent

from ..rig.hand import is_skinned_to
from ..scene.handlers import add_handlers, remove_handlers


def copy_missing_meshes() -> None:
    """Give each copied armature that lacks a mesh a copy of the first hand's."""
    for armature in list(bpy.data.objects):
        source = armature.livehand.mesh if armature.livehand.is_hand and _is_changeable(armature) else None
        if source is not None and source.livehand.is_skin and not _has_mesh(armature):
            _copy_mesh(source, armature)


def remove_orphans() -> None:
    """Remove the meshes whose armatures were deleted, unless they may be selected and so deleted by the user."""
    for mesh in list(bpy.data.objects):
        if mesh.livehand.is_skin and not mesh.livehand.mesh_selectable and _is_changeable(mesh):
            armature = mesh.find_armature()
            if armature is None or not armature.users_scene:
                data = mesh.data
                bpy.data.objects.remove(mesh)
                if not data.users:
                    bpy.data.meshes.remove(data)


def _is_changeable(thing: bpy.types.Object) -> bool:
    return thing.library is None and thing.override_library is None and bool(thing.users_scene)


def _has_mesh(armature: bpy.types.Object) -> bool:
    mesh = armature.livehand.mesh
    candidates = (mesh, *armature.children_recursive)
    return any(thing is not None and is_skinned_to(thing, armature) for thing in candidates)


def _copy_mesh(source: bpy.types.Object, armature: bpy.types.Object) -> None:
    """Copy the mesh, its shape keys and their drivers, for this armature to deform."""
    first = source.find_armature()
    mesh = source.copy()
    mesh.data = source.data.copy()
    for collection in armature.users_collection:
        collection.objects.link(mesh)
    if source.parent == first:
        mesh.parent = armature
    for modifier in mesh.modifiers:
        if modifier.type == "ARMATURE" and modifier.object == first:
            modifier.object = armature
    for owner in (mesh, mesh.data, mesh.data.shape_keys):
        _retarget_drivers(owner, first, armature)
    armature.livehand.mesh = mesh


def _retarget_drivers(owner: bpy.types.ID | None, before: bpy.types.Object | None, after: bpy.types.Object) -> None:
    animation = owner.animation_data if owner is not None else None
    for curve in animation.drivers if animation else ():
        for variable in curve.driver.variables:
            for target in variable.targets:
                if target.id == before:
                    target.id = after


@persistent
def _look(*_) -> None:
    """Look for new objects after each change of the file."""
    count = len(bpy.data.objects)
    if count != _ObjectCount.value:
        _ObjectCount.value = count
        if bpy.app.background:
            _make_whole()
        elif not bpy.app.timers.is_registered(_make_whole):
            bpy.app.timers.register(_make_whole, first_interval=0.0)


@persistent
def _begin(*_) -> None:
    """Begin after a file was opened, which stays as it is."""
    _ObjectCount.value = len(bpy.data.objects)


def _make_whole() -> None:
    copy_missing_meshes()
    remove_orphans()
    _ObjectCount.value = len(bpy.data.objects)


class _ObjectCount:
    """The number of objects when we last looked."""

    value = 0


_WATCHED = (("depsgraph_update_post", _look), ("load_post", _begin))


def watch_objects() -> None:
    """Keep hands whole from now on."""
    add_handlers(_WATCHED)


def stop_watching() -> None:
    """Undo `watch_objects`."""
    remove_handlers(_WATCHED)
    if bpy.app.timers.is_registered(_make_whole):
        bpy.app.timers.unregister(_make_whole)
