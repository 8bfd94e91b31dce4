"""The objects that all 3D views share."""

from __future__ import annotations

from ....backend.render.preview_scheduler import PreviewScheduler
from ....backend.render.session import Session
from .redraw import RedrawTimer


class ViewportShared:
    """The session with its avatars, one thread and one timer. The registered render engine owns it."""

    def __init__(self, session: Session):
        self.session = session
        self.preview = PreviewScheduler()
        self.timer = RedrawTimer(self.preview)

    def close(self) -> None:
        """Stop the thread and the timer."""
        self.timer.stop()
        self.preview.close()
