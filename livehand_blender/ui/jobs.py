"""Operators whose work is done by another process while Blender's window goes on: progress in the status bar, Esc."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol

import bpy

from ...backend.records.errors import LiveHandError
from ...backend.system.child_job import JobProgress

_INTERVAL_S = 0.1


class BackgroundJob(Protocol):
    """Work that goes on by itself between steps, as `ChildJob`."""

    @property
    def progress(self) -> JobProgress:
        """What it does now."""
        ...

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        ...

    def wait(self) -> None:
        """Wait for the end."""
        ...

    def cancel(self) -> None:
        """End it, so that nothing has changed."""
        ...


class RunsJob:
    """Mixin of operators that start a job, wait for it without stopping Blender, and take its result.

    An operator defines `start` and `take`, both of which may raise LiveHandError.
    """

    bl_label: str
    report: Callable[[set[str], str], None]
    start: Callable[[bpy.types.Context], Any]
    take: Callable[[bpy.types.Context, Any], None]

    def execute(self, context):
        """Start; in a window, Blender then calls `modal` by a timer, else it waits."""
        try:
            self._job = self.start(context)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if bpy.app.background or context.window is None:
            self._job.wait()
            return self._taken(context)
        self._timer = context.window_manager.event_timer_add(_INTERVAL_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Show what is being done; Esc cancels, and nothing has changed."""
        if event.type == "ESC" and event.value == "PRESS":
            self.cancel(context)
            self.report({"INFO"}, f"{self.bl_label}: canceled, nothing has changed")
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if self._job.is_running:
            context.workspace.status_text_set(self._drawn_status())
            return {"PASS_THROUGH"}
        self._end(context)
        return self._taken(context)

    def cancel(self, context):
        """Stop, also when the window was closed."""
        self._job.cancel()
        self._end(context)

    def _drawn_status(self) -> Callable[[bpy.types.Header, bpy.types.Context], None]:
        """Return a function that draws the job's progress, and how to cancel it, into the status bar."""
        label, now = self.bl_label, self._job.progress

        def draw(header: bpy.types.Header, context: bpy.types.Context) -> None:
            row = header.layout.row(align=True)
            row.label(text="Cancel", icon="EVENT_ESC")
            row.separator(factor=2.0)
            if now.share is None:
                row.label(text=f"{label}: {now.text}")
            else:
                row.progress(factor=now.share, text=f"{label}: {now.text}")

        return draw

    def _end(self, context: bpy.types.Context) -> None:
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)

    def _taken(self, context: bpy.types.Context) -> set[str]:
        try:
            self.take(context, self._job)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        return {"FINISHED"}
