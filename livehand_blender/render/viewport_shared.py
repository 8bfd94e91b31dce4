"""The objects that all 3D views share: the session, a thread that renders, and a timer that redraws."""

from __future__ import annotations

import weakref
from typing import Protocol

import bpy

from ...backend.render.preview_scheduler import PreviewScheduler
from ...backend.render.session import Session
from ..scene.settings import ENGINE
from .preparation import Preparation

_INTERVAL_S = 0.01


class ViewportShared:
    """The session with its avatars, one thread and one timer. The registered render engine owns it."""

    def __init__(self, session: Session, preparation: Preparation | None = None):
        self.session = session
        self.preparation = preparation or Preparation()
        self.preview = PreviewScheduler()
        self.timer = RedrawTimer(self.preview)

    def close(self) -> None:
        """Stop the thread and the timer."""
        self.timer.stop()
        self.preview.close()


class WatchedView(Protocol):
    """A view that waits for images."""

    @property
    def is_uploading(self) -> bool:
        """Whether its next drawing has more of an image to upload."""
        ...


class RedrawTimer:
    """Polls the rendering thread from Blender's thread, the only one that may tag a view for redraw."""

    def __init__(self, preview: PreviewScheduler):
        self._preview = preview
        # Weak: Cycles ends its session when Python frees the engine, which must not be later than Blender does.
        self._engines: dict[WatchedView, weakref.ref[bpy.types.RenderEngine]] = {}
        # Blender identifies a timer by its function object, and every access to a bound method makes a new one.
        self._callback = self._tick

    def watch(self, view: WatchedView, engine: bpy.types.RenderEngine) -> None:
        """Redraw the engine's view whenever an image is ready, or a part of one, until none is awaited."""
        self._engines[view] = weakref.ref(engine)
        if not bpy.app.timers.is_registered(self._callback):
            bpy.app.timers.register(self._callback, first_interval=_INTERVAL_S)

    def update_meshes(self) -> None:
        """Let Cycles read the hands' meshes again, which it sees only while no image stands for them."""
        if not bpy.app.timers.is_registered(_tag_meshes):
            bpy.app.timers.register(_tag_meshes, first_interval=_INTERVAL_S)

    def stop(self) -> None:
        """Remove the timers."""
        self._engines.clear()
        for callback in (self._callback, _tag_meshes):
            if bpy.app.timers.is_registered(callback):
                bpy.app.timers.unregister(callback)

    def _tick(self) -> float | None:
        for view, reference in list(self._engines.items()):
            self._check(view, reference())
        return _INTERVAL_S if self._engines else None

    def _check(self, view: WatchedView, engine: bpy.types.RenderEngine | None) -> None:
        if engine is None:  # the view was closed, or its shading changed
            self._preview.forget(view)
        is_more = engine is not None and view.is_uploading
        is_busy = is_more or self._preview.is_busy(view)  # first: what ends after this is an outcome at the next tick
        if engine is not None and (is_more or self._preview.has_outcome(view)):
            engine.tag_redraw()
        if not is_busy:
            del self._engines[view]


def _tag_meshes() -> None:
    """Tag the meshes in Blender's main loop: a drawing callback must not tag anything."""
    for thing in bpy.data.objects:
        if thing.livehand.is_hand and thing.livehand.mesh is not None:
            thing.livehand.mesh.update_tag()


def stop_rendered_views() -> None:
    """Set the views that our engine draws to Solid, which frees their engines at once.

    Unregistering the class would free them as well, but in the middle of Blender's own list of engines, while Cycles'
    thread may wait for Python.
    """
    for space in rendered_views():
        space.shading.type = "SOLID"


def rendered_views() -> list[bpy.types.SpaceView3D]:
    """List the 3D views of all windows that are in Rendered shading, of scenes with our engine."""
    return [
        space
        for manager in bpy.data.window_managers
        for window in manager.windows
        if window.scene.render.engine == ENGINE
        for area in window.screen.areas
        for space in area.spaces
        if isinstance(space, bpy.types.SpaceView3D) and space.shading.type == "RENDERED"
    ]
