"""Removes scenes that LiveHand made for a moment: to render, to decode a movie, to import or to write a file.

`bpy.data.scenes.remove` is not for this: up to Blender 4.3 it reads the context's window. A script that has opened a
file runs without one, as render queues do, and Blender crashes.

The context's window is not overridden for it, either: measured light is rendered while a frame is, and there may be no
window at all.
"""

from __future__ import annotations

from collections.abc import Iterable

import bpy

_CRASHES_AFTER_REMOVALS = (5, 2)
"""From this version of Blender on an animation crashes at its next frame if a frame's render has removed objects or
scenes: the copy of the scene that it evaluates then lacks originals. No LiveHand is needed for it."""


def remove_scene(scene: bpy.types.Scene, others: Iterable[bpy.types.ID] = ()) -> None:
    """Remove a scene that no window shows, whatever the context is.

    Args:
        scene: made by LiveHand.
        others: data-blocks that were made for it, such as its camera and that camera's lens, and are removed
            with it.

    Raises:
        ValueError: a window shows the scene, and would be left without one.
    """
    if is_shown(scene):
        raise ValueError(f"a scene to be removed must not be shown by a window, {scene.name!r} is; show another first")
    bpy.data.batch_remove([scene, *others])


def is_shown(scene: bpy.types.Scene) -> bool:
    """Return whether any of Blender's windows shows the scene.

    All windows are asked, not only the context's, and a Blender without an interface has one, too.
    """
    managers = bpy.data.window_managers
    windows = (window for manager in managers for window in manager.windows)
    return any(window.scene == scene for window in windows)


def settle_removals(depsgraph: bpy.types.Depsgraph) -> None:
    """Bring a frame's depsgraph up to date with what was removed while the frame is rendered."""
    if bpy.app.version >= _CRASHES_AFTER_REMOVALS:
        depsgraph.update()
