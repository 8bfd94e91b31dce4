"""A 3D view in Rendered shading: the engine calls `update` when the scene changes and `draw` at every redraw."""

from __future__ import annotations

import logging
from functools import partial

import bpy
import numpy as np

from ....backend.records.camera import Camera
from ....backend.records.errors import LiveHandError
from ....backend.rendering.frame_task import is_equal
from ...scene.colour import rec709_to_working_space
from ...scene.foreground import read_foreground
from .draw import ImageTexture, draw_message
from .image import ViewportRequest
from .shared import ViewportShared
from .view import RegionView, read_view
from .viewport_hand import ViewportHand, read_viewport_hands

LOGGER = logging.getLogger(__name__)

# The longer side of the coarse image that is shown while things move, px.
_COARSE_PX = 256


def viewport_of(engine) -> Viewport:
    """The engine's viewport, made at the first call: not every engine that Blender makes is for a view."""
    if not hasattr(engine, "viewport"):
        engine.viewport = Viewport(type(engine).viewport_shared)
    return engine.viewport


class Viewport:
    """One 3D view. The engine that Blender makes for the view owns it; it keeps no reference to Blender's objects.

    Attributes:
        has_image: whether the hands are drawn; if not, their meshes stand for them in Cycles' preview.
    """

    def __init__(self, shared: ViewportShared):
        self._shared = shared
        self._hands: tuple[ViewportHand, ...] = ()
        self._problem = ""  # why the hands cannot be read
        self._submitted: tuple[ViewportRequest, tuple[float, ...]] | None = None
        self._texture: ImageTexture | None = None
        self.has_image = False
        self._is_empty = False  # the newest image shows no hand
        self._foreground: tuple[Camera, np.ndarray] | None = None
        self._message = ""  # the outcome of the last request, if it is not an image

    def update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Read the hands."""
        self._foreground = None
        try:
            self._hands, self._problem = read_viewport_hands(context.space_data, depsgraph), ""
        except Exception as error:
            self._hands, self._problem = (), _message_of(error)

    def draw(self, engine: bpy.types.RenderEngine, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Submit the view's request if it has changed, and draw the newest image."""
        message = self._problem
        if not message:
            try:
                message = self._draw_view(engine, context, depsgraph, read_view(context, depsgraph))
            except Exception as error:  # raised to Blender, it would keep the engine alive, and Cycles would crash
                message = _message_of(error)
        has_image = not message and (self._texture is not None or self._is_empty)
        if has_image != self.has_image:
            self.has_image = has_image
            self._shared.timer.update_meshes()
        if message:
            draw_message(f"LiveHand: {message}", context.region.width, context.preferences.system.ui_scale)

    def _draw_view(
        self,
        engine: bpy.types.RenderEngine,
        context: bpy.types.Context,
        depsgraph: bpy.types.Depsgraph,
        view: RegionView | None,
    ) -> str:
        """Draw the newest image; returns the message to draw with it."""
        if view is None:
            return ""
        self._submit(engine, depsgraph, view, _scales(view, context))
        self._receive()
        if self._texture:
            self._texture.draw(view.rectangle, context.region.height)
        return self._message

    def _submit(
        self,
        engine: bpy.types.RenderEngine,
        depsgraph: bpy.types.Depsgraph,
        view: RegionView,
        scales: tuple[float, ...],
    ) -> None:
        if self._foreground is None or not is_equal(self._foreground[0], view.camera):
            places = {hand.place for hand in self._hands}
            vertices = [hand.vertices for hand in self._hands]
            self._foreground = view.camera, read_foreground(depsgraph, view.camera, vertices, places)
        request = ViewportRequest(self._hands, view.camera, rec709_to_working_space(), self._foreground[1])
        if self._submitted and is_equal((request, scales), self._submitted):
            return
        if self._submitted is None and self._hands:
            self._message = "loading the avatar"
        self._submitted = request, scales
        self._shared.preview.submit(self, [partial(request.render, self._shared.session, scale) for scale in scales])
        self._shared.timer.watch(self, engine)

    def _receive(self) -> None:
        outcome = self._shared.preview.pop_outcome(self)
        if outcome is not None:
            self._message = _message_of(outcome.error) if outcome.error else ""
            self._texture = ImageTexture(outcome.value) if outcome.value else None
            self._is_empty = not outcome.error and not outcome.value


def _scales(view: RegionView, context: bpy.types.Context) -> tuple[float, ...]:
    """The scales of the images to render: a coarse one and, unless an animation plays, the view's full resolution."""
    full = 1 / _pixel_size(context)
    coarse = min(full / 2, _COARSE_PX / max(view.camera.size_px))
    return (coarse,) if context.screen.is_animation_playing else (coarse, full)


def _pixel_size(context: bpy.types.Context) -> int:
    """Screen pixels along the side of a rendered pixel: the scene's *Pixel Size*, read as Cycles reads it."""
    chosen = context.scene.render.preview_pixel_size
    if chosen != "AUTO":
        return int(chosen)
    return 2 if context.preferences.system.pixel_size > 1.5 else 1


def _message_of(error: Exception) -> str:
    if isinstance(error, LiveHandError):
        return str(error)
    LOGGER.error("The 3D view failed", exc_info=error)
    return f"stopped on an unexpected {type(error).__name__}: {error}"
