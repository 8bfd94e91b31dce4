"""Registration of classes, properties, menus and the render engine; `unregister` is in reverse order."""

from __future__ import annotations

import bpy

from .blender_command import BlenderCommand
from .hands import hand_duplication, hand_selection
from .motion import live as live_hands
from .render import engine, memory, package_folder
from .render.viewport_shared import stop_rendered_views
from .rig import properties
from .scene import main_thread
from .ui import (
    avatars,
    compositing,
    hand_model,
    ik_grab,
    live,
    look,
    motion,
    motion_files,
    new_scene,
    operators,
    packages,
    panels,
    person,
    picker,
    pose_library,
    posing,
    preferences,
    shape,
    studio,
    video,
)
from .ui import rigs as retarget
from .ui.export import splats

CLASSES = (
    *properties.CLASSES,
    *operators.CLASSES,
    *packages.CLASSES,
    *studio.CLASSES,
    *new_scene.CLASSES,
    *posing.CLASSES,
    *pose_library.CLASSES,
    *shape.CLASSES,
    *compositing.CLASSES,
    *preferences.CLASSES,
    *panels.CLASSES,
    *avatars.CLASSES,
    *person.CLASSES,
    *look.CLASSES,
    *picker.CLASSES,
    *motion.CLASSES,
    *splats.CLASSES,
    *live.CLASSES,
    *video.CLASSES,
    *retarget.CLASSES,
    *hand_model.CLASSES,
    *engine.CLASSES,
)


def register() -> None:
    """Register everything; classes come first, because properties and menus refer to them."""
    package_folder.use_packages()
    for cls in CLASSES:
        bpy.utils.register_class(cls)
    properties.attach()
    panels.add_to_menus()
    packages.add_to_header()
    motion_files.add_to_menus()
    video.add_to_menus()
    engine.register_panels()
    memory.watch_renders()
    hand_duplication.watch_objects()
    hand_selection.watch_selection()
    ik_grab.watch_targets()
    live_hands.watch_files()
    pose_library.add_keys()
    main_thread.start()
    engine.prepare_soon()
    BlenderCommand.register()


def unregister() -> None:
    """Unregister everything: Blender 4.5 as a module hangs at exit if anything is still registered."""
    stop_rendered_views()
    BlenderCommand.unregister()
    engine.stop_preparing()
    main_thread.stop()
    pose_library.remove_keys()
    live_hands.stop_watching()
    ik_grab.stop_watching()
    hand_selection.stop_watching()
    hand_duplication.stop_watching()
    memory.stop_watching()
    engine.unregister_panels()
    video.remove_from_menus()
    motion_files.remove_from_menus()
    packages.remove_from_header()
    panels.remove_from_menus()
    properties.detach()
    for cls in reversed(CLASSES):
        bpy.utils.unregister_class(cls)
    package_folder.forget_packages()
