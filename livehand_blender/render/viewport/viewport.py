"""A 3D view in Rendered shading: the engine calls `update` when the scene changes and `draw` at every redraw."""

from __future__ import annotations

import logging

import bpy

from ....backend.records.errors import LiveHandError
from ....backend.render.frame_task import is_equal
from ....backend.render.preview_scheduler import StepOutcome
from ...hands.visible_hands import InstanceId, VisibleHand, visible_hands
from ...light.foreground import Foreground
from ...light.local_triangles import LocalTriangles
from ...scene.colour import rec709_to_working_space
from .draw import ImageTexture, draw_message
from .image import ViewportRequest
from .pace import Pace
from .shared import ViewportShared
from .step import ViewportStep
from .view import RegionView, read_view
from .viewport_hand import ViewportHand, read_viewport_hands

LOGGER = logging.getLogger(__name__)


def viewport_of(engine) -> Viewport:
    """The engine's viewport, made at the first call: not every engine that Blender makes is for a view."""
    if not hasattr(engine, "viewport"):
        engine.viewport = Viewport(type(engine).viewport_shared)
    return engine.viewport


class Viewport:
    """One 3D view, owned by the engine that Blender makes for it; it refers to no Blender object once it has read them.

    Attributes:
        has_image: whether the hands are drawn; if not, their meshes stand for them in Cycles' preview.
    """

    def __init__(self, shared: ViewportShared):
        self._shared = shared
        self._hands: tuple[ViewportHand, ...] = ()
        self._problem = ""  # why the hands cannot be read
        self._submitted: tuple[ViewportRequest, float, bool] | None = None
        self._pace = Pace()
        self._texture: ImageTexture | None = None
        self.has_image = False
        self._is_empty = False  # the newest image shows no hand
        self._is_stale = True  # the scene has changed since it was read
        self._visible: tuple[VisibleHand, ...] | None = None  # of the changed scene, from its update to its reading
        self._triangles = LocalTriangles()
        self._foreground: Foreground | None = None
        self._message = ""  # the outcome of the last request, if it is not an image

    def update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Note that the scene has changed."""
        self._is_stale, self._visible = True, None
        self._triangles.forget_changed(depsgraph)

    def hand_meshes(self, depsgraph: bpy.types.Depsgraph) -> tuple[InstanceId, ...]:
        """The meshes of all hands of a scene that has changed, which are read once for this and for the drawing.

        Raises:
            LiveHandError: a hand of the scene has no mesh.
        """
        self._visible = visible_hands(depsgraph)
        return tuple(hand.instance_id for hand in self._visible)

    def draw(self, engine: bpy.types.RenderEngine, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Submit the view's request if it has changed, and draw the newest image."""
        # Of the frames of an animation, only those are read that will be shown: one while the one before is rendered.
        if self._is_stale and not self._shared.preview.is_waiting(self):
            self._read(context, depsgraph)
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

    def _read(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        self._is_stale = False
        self._foreground = None
        self._triangles.forget_unasked()
        try:
            visible = visible_hands(depsgraph) if self._visible is None else self._visible
            self._hands = read_viewport_hands(context.space_data, depsgraph, visible, self._triangles)
            self._problem = ""
        except Exception as error:
            self._hands, self._problem = (), _message_of(error)
        self._visible = None

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
        self._submit(engine, depsgraph, view, 1 / _pixel_size(context), context.screen.is_animation_playing)
        self._receive()
        if self._texture:
            self._texture.draw(view.rectangle, context.region.height)
        return self._message

    def _submit(
        self,
        engine: bpy.types.RenderEngine,
        depsgraph: bpy.types.Depsgraph,
        view: RegionView,
        scale: float,
        is_playing: bool,
    ) -> None:
        """Ask for an image that keeps pace and, unless an animation plays, one of the full scale."""
        if self._is_stale:  # another frame waits, and will be shown first
            return
        if self._foreground is None:
            self._foreground = Foreground(depsgraph, {hand.instance_id for hand in self._hands}, self._triangles)
        solids = self._foreground.before(depsgraph, view.camera, [hand.vertices for hand in self._hands])
        request = ViewportRequest(self._hands, view.camera, rec709_to_working_space(), solids)
        if self._submitted and is_equal((request, scale, is_playing), self._submitted):
            return
        if self._submitted is None and self._hands:
            self._message = "loading the avatar"
        self._submitted = request, scale, is_playing
        moving, still = self._moving_step(request, scale), ViewportStep(request, self._shared.session, scale)
        self._shared.preview.submit(self, [moving] if is_playing else [moving, still])
        self._shared.timer.watch(self, engine)

    def _moving_step(self, request: ViewportRequest, scale: float) -> ViewportStep:
        moving_px = self._pace.side_px
        moving_scale = min(scale, moving_px / max(request.camera.size_px))
        return ViewportStep(request, self._shared.session, moving_scale, moving_px)

    def _receive(self) -> None:
        outcome = self._shared.preview.pop_outcome(self)
        if outcome is not None:
            self._keep_pace(outcome)
            self._message = _message_of(outcome.error) if outcome.error else ""
            self._texture = ImageTexture(outcome.value) if outcome.value else None
            self._is_empty = not outcome.error and not outcome.value

    def _keep_pace(self, outcome: StepOutcome) -> None:
        step = outcome.step
        if isinstance(step, ViewportStep) and step.moving_px is not None and outcome.value is not None:
            self._pace.record(step.moving_px, outcome.seconds)


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
