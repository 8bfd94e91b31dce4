"""What the render engine calls for a 3D view in Rendered shading: `update` when the scene changes, `draw` always."""

from __future__ import annotations

import logging
from functools import partial

import bpy

from ....backend.records.errors import LiveHandError
from ....backend.rendering.frame_task import is_equal
from ...scene.colour import rec709_to_working_space
from .draw import PictureTexture, draw_message
from .picture import ViewportRequest
from .studio import ViewportShared
from .subject import ViewportHand, read_viewport_hands
from .view import RegionView, read_view

LOGGER = logging.getLogger(__name__)

# The longer side of the view in the picture that is shown while things move, px.
_COARSE_PX = 256


def viewport_of(engine) -> Viewport:
    """An engine's own, made when it is first asked for: Blender makes engines for other ends too."""
    if not hasattr(engine, "viewport"):
        engine.viewport = Viewport(type(engine).studio)
    return engine.viewport


class Viewport:
    """One 3D view. It belongs to the engine that Blender makes for the view, and holds on to nothing of Blender's."""

    def __init__(self, studio: ViewportShared):
        self._studio = studio
        self._subjects: tuple[ViewportHand, ...] = ()
        self._problem = ""  # what keeps the hands from being read
        self._asked: tuple[ViewportRequest, tuple[float, ...]] | None = None
        self._texture: PictureTexture | None = None
        self._message = ""  # what came of the last request instead of a picture

    def update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Read the hands as they stand now."""
        try:
            self._subjects, self._problem = read_viewport_hands(context.space_data, depsgraph), ""
        except Exception as error:
            self._subjects, self._problem = (), _words(error)

    def draw(self, engine: bpy.types.RenderEngine, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Ask for what the view has become, and draw what has come."""
        message = self._problem
        if not message:
            try:
                message = self._draw_view(engine, context, read_view(context, depsgraph))
            except Exception as error:  # one that went on to Blender would keep the engine alive, and Cycles crash
                message = _words(error)
        if message:
            draw_message(f"LiveHand: {message}", context.region.width, context.preferences.system.ui_scale)

    def _draw_view(self, engine: bpy.types.RenderEngine, context: bpy.types.Context, view: RegionView | None) -> str:
        """Draw the picture, and return the message that belongs to it."""
        if view is None:
            return ""
        self._ask(engine, view, _scales(view, context))
        self._take()
        if self._texture:
            self._texture.draw(view.rectangle, context.region.height)
        return self._message

    def _ask(self, engine: bpy.types.RenderEngine, view: RegionView, scales: tuple[float, ...]) -> None:
        order = ViewportRequest(self._subjects, view.camera, rec709_to_working_space())
        if self._asked and is_equal((order, scales), self._asked):
            return
        if self._asked is None and self._subjects:
            self._message = "loading the avatar"
        self._asked = order, scales
        self._studio.preview.ask(self, [partial(order.render, self._studio.session, scale) for scale in scales])
        self._studio.timer.watch(self, engine)

    def _take(self) -> None:
        outcome = self._studio.preview.take(self)
        if outcome is not None:
            self._message = _words(outcome.error) if outcome.error else ""
            self._texture = PictureTexture(outcome.value) if outcome.value else None


def _scales(view: RegionView, context: bpy.types.Context) -> tuple[float, ...]:
    """Sizes of the pictures to ask for, of the view's own: a coarse one and, unless an animation plays, a full one."""
    full = 1 / _pixel_size(context)
    coarse = min(full / 2, _COARSE_PX / max(view.camera.size_px))
    return (coarse,) if context.screen.is_animation_playing else (coarse, full)


def _pixel_size(context: bpy.types.Context) -> int:
    """Screen pixels to the side of a rendered one: the scene's *Pixel Size*, read as Cycles reads it."""
    chosen = context.scene.render.preview_pixel_size
    if chosen != "AUTO":
        return int(chosen)
    return 2 if context.preferences.system.pixel_size > 1.5 else 1


def _words(error: Exception) -> str:
    if isinstance(error, LiveHandError):
        return str(error)
    LOGGER.error("The 3D view failed", exc_info=error)
    return f"stopped on an unexpected {type(error).__name__}: {error}"
