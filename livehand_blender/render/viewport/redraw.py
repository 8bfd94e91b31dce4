"""Redraws views whose pictures have come: a timer of Blender's that runs only while some are awaited."""

from __future__ import annotations

import weakref

import bpy

from ....backend.rendering.preview_scheduler import PreviewScheduler

_INTERVAL_S = 0.01


class RedrawTimer:
    """Only Blender's thread may tag a view, so it looks every hundredth of a second for what the other has done."""

    def __init__(self, preview: PreviewScheduler):
        self._preview = preview
        # Weakly: Cycles ends an engine's session when Python lets go of it, which must not be later than Blender does.
        self._engines: dict[object, weakref.ref[bpy.types.RenderEngine]] = {}
        self._callback = self._tick  # Blender knows a timer by the function object, and a bound method is new each time

    def watch(self, view: object, engine: bpy.types.RenderEngine) -> None:
        """Redraw the engine's view when pictures come, until none is awaited."""
        self._engines[view] = weakref.ref(engine)
        if not bpy.app.timers.is_registered(self._callback):
            bpy.app.timers.register(self._callback, first_interval=_INTERVAL_S)

    def stop(self) -> None:
        """Leave no timer behind."""
        self._engines.clear()
        if bpy.app.timers.is_registered(self._callback):
            bpy.app.timers.unregister(self._callback)

    def _tick(self) -> float | None:
        for view, reference in list(self._engines.items()):
            self._look_after(view, reference())
        return _INTERVAL_S if self._engines else None

    def _look_after(self, view: object, engine: bpy.types.RenderEngine | None) -> None:
        if engine is None:  # the view is closed, or shaded otherwise
            self._preview.forget(view)
        is_busy = self._preview.is_busy(view)  # asked first: what ends after this question is news at the next tick
        if engine is not None and self._preview.has_news(view):
            engine.tag_redraw()
        if not is_busy:
            del self._engines[view]
