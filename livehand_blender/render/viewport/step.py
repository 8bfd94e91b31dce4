"""One step of showing a view: an image of one size, a quick one while things move or a fine one when they rest."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from ....backend.render.session import Session
from .image import ViewportImage, ViewportRequest


@dataclass(frozen=True)
class ViewportStep:
    """A step that the preview's thread runs.

    Attributes:
        request: what to render.
        session: of the avatars.
        scale: of the image, times the view's resolution.
        moving_px: the longer side that the view's pace chose for an image of what moves, of which the scale came; None:
            the image is of what rests, with fine penumbras.
    """

    request: ViewportRequest
    session: Session
    scale: float
    moving_px: int | None = None

    def __call__(self, should_stop: Callable[[], bool]) -> ViewportImage | None:
        """Render the image, as `ViewportRequest.render`."""
        return self.request.render(self.session, self.scale, should_stop, self.moving_px is not None)
