"""Redraws views whose pictures have come: a timer of Blender's that runs only while some are awaited."""

from __future__ import annotations

import bpy

from .preview import Preview

_INTERVAL_S = 0.01


class RedrawTimer:
    """Only Blender's thread may tag a view, so it looks every hundredth of a second for what the other has done."""

    def __init__(self, preview: Preview):
        self._preview = preview
        self._engines: dict[object, bpy.types.RenderEngine] = {}
        self._callback = self._tick  # Blender knows a timer by the function object, and a bound method is new each time

    def watch(self, view: object, engine: bpy.types.RenderEngine) -> None:
        """Redraw the engine's view when pictures come, until none is awaited."""
        self._engines[view] = engine
        if not bpy.app.timers.is_registered(self._callback):
            bpy.app.timers.register(self._callback, first_interval=_INTERVAL_S)

    def stop(self) -> None:
        """Leave no timer behind."""
        self._engines.clear()
        if bpy.app.timers.is_registered(self._callback):
            bpy.app.timers.unregister(self._callback)

    def _tick(self) -> float | None:
        for view, engine in list(self._engines.items()):
            if not self._preview.is_busy(view):
                del self._engines[view]
            if self._preview.has_news(view):
                self._redraw(view, engine)
        return _INTERVAL_S if self._engines else None

    def _redraw(self, view: object, engine: bpy.types.RenderEngine) -> None:
        try:
            engine.tag_redraw()
        except ReferenceError:  # Blender has freed it: the view is closed, or shaded otherwise
            self._engines.pop(view, None)
            self._preview.forget(view)
