"""Everything Blender is told about, in order; `unregister` goes back the same way."""

from __future__ import annotations

import bpy

from .blender_command import BlenderCommand
from .render import engine, memory
from .rig import properties
from .ui import (
    avatars,
    compositing,
    hand_model,
    keying_set,
    motion,
    motion_files,
    operators,
    panels,
    picker,
    pose_library,
    posing,
    preferences,
    shape,
)
from .ui import retarget as foreign_rig

CLASSES = (
    *properties.CLASSES,
    *operators.CLASSES,
    *posing.CLASSES,
    *keying_set.CLASSES,
    *pose_library.CLASSES,
    *shape.CLASSES,
    *compositing.CLASSES,
    *preferences.CLASSES,
    *panels.CLASSES,
    *avatars.CLASSES,
    *picker.CLASSES,
    *motion.CLASSES,
    *foreign_rig.CLASSES,
    *hand_model.CLASSES,
    *engine.CLASSES,
)


def register() -> None:
    """Classes first: properties and menus refer to them."""
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    properties.attach()
    panels.add_to_menus()
    motion_files.add_to_menus()
    engine.register_panels()
    memory.watch_renders()
    BlenderCommand.register()


def unregister() -> None:
    """What stays registered at exit hangs Blender 4.5 as a module, so nothing may be left."""
    BlenderCommand.unregister()
    memory.stop_watching()
    engine.unregister_panels()
    motion_files.remove_from_menus()
    panels.remove_from_menus()
    properties.detach()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
