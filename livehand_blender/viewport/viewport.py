"""What the render engine calls for a 3D view in Rendered shading: `update` when the scene has changed, `draw` always."""

from __future__ import annotations

import logging
from functools import partial

import bpy
import numpy as np

from ...backend.errors import LiveHandError
from ..render.session import Device, Session
from ..render.task import is_equal
from ..rig.hand import mesh_of
from ..rig.pose import read_hand_pose
from ..scene.colour import rec709_to_working_space
from ..scene.shot import hand_source, visible_hands, world_vertices
from .draw import PictureTexture, draw_message
from .picture import Order, Subject
from .preview import Outcome, Preview
from .redraw import RedrawTimer
from .view import View, read_view

LOGGER = logging.getLogger(__name__)

# The longer side of the picture that is shown while things move, px.
_COARSE_PX = 256


class Studio:
    """What all views share: the session, one thread, one timer. Belongs to the registered render engine."""

    def __init__(self, session: Session):
        self.session = session
        self.preview = Preview()
        self.timer = RedrawTimer(self.preview)

    def close(self) -> None:
        """End the thread and the timer."""
        self.timer.stop()
        self.preview.close()


class Viewport:
    """One 3D view. It belongs to the engine that Blender makes for the view."""

    def __init__(self, studio: Studio):
        self._studio = studio
        self._subjects: tuple[Subject, ...] = ()
        self._problem = ""  # what keeps the hands from being read
        self._asked: tuple[Order, tuple[float, ...]] | None = None
        self._texture: PictureTexture | None = None
        self._message = ""  # what came of the last request instead of a picture

    def update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Read the hands as they stand now."""
        self._problem = ""
        try:
            self._subjects = _read_subjects(context.space_data, depsgraph)
        except LiveHandError as error:
            self._subjects, self._problem = (), str(error)

    def draw(self, engine: bpy.types.RenderEngine, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Draw what has come, and ask for what the view has become."""
        region = context.region
        try:
            view = None if self._problem else read_view(context, depsgraph)
            problem = self._problem
        except LiveHandError as error:
            view, problem = None, str(error)
        if view is not None:
            self._ask(engine, view, _scales(view, context))
            self._take()
            if self._texture:
                self._texture.draw(view.rectangle, region.height)
            problem = self._message
        if problem:
            draw_message(f"LiveHand: {problem}", region.width)

    def _ask(self, engine: bpy.types.RenderEngine, view: View, scales: tuple[float, ...]) -> None:
        order = Order(self._subjects, view.camera, rec709_to_working_space())
        if self._asked and is_equal((order, scales), self._asked):
            return
        if self._asked is None and self._subjects:
            self._message = "loading the avatar"
        self._asked = order, scales
        steps = [partial(order.render, self._studio.session, scale) for scale in scales]
        self._studio.preview.ask(self, steps)
        self._studio.timer.watch(self, engine)

    def _take(self) -> None:
        outcome = self._studio.preview.take(self)
        if outcome is None:
            return
        self._message = _message(outcome)
        self._texture = PictureTexture(outcome.value) if outcome.value else None


def viewport_of(engine) -> Viewport:
    """The engine's own, made when it is first asked for: Blender makes engines for other ends too."""
    if not hasattr(engine, "viewport"):
        engine.viewport = Viewport(type(engine).studio)
    return engine.viewport


def hide_from_camera(depsgraph: bpy.types.Depsgraph) -> None:
    """Take the hands' meshes out of the preview, their shadows and reflections not. Only evaluated copies change."""
    hidden = {mesh_of(hand.original).name_full for hand in visible_hands(depsgraph)}
    names = [thing.name_full for thing in depsgraph.objects]
    is_visible = np.empty(len(names), bool)
    depsgraph.objects.foreach_get("visible_camera", is_visible)
    is_visible &= [name not in hidden for name in names]
    # Setting the property of one object tags the scene as changed, and the view would be updated for ever.
    depsgraph.objects.foreach_set("visible_camera", is_visible)


def _read_subjects(space: bpy.types.SpaceView3D, depsgraph: bpy.types.Depsgraph) -> tuple[Subject, ...]:
    settings = depsgraph.scene.livehand
    device = Device(settings.device, settings.precision)
    return tuple(
        Subject(
            hand_source(hand),
            device,
            read_hand_pose(hand, depsgraph),
            world_vertices(mesh_of(hand.original).evaluated_get(depsgraph)),
        )
        for hand in visible_hands(depsgraph)
        if mesh_of(hand.original).visible_in_viewport_get(space)
    )


def _scales(view: View, context: bpy.types.Context) -> tuple[float, ...]:
    """Sizes of the pictures to ask for, of the view's own: a coarse one, and unless an animation plays a full one."""
    full = 1 / _pixel_size(context)
    coarse = min(full / 2, _COARSE_PX / max(view.camera.size_px))
    return (coarse,) if context.screen.is_animation_playing else (coarse, full)


def _pixel_size(context: bpy.types.Context) -> int:
    """Screen pixels to a rendered one's side: the scene's choice (Performance > Viewport), as Cycles reads it."""
    chosen = context.scene.render.preview_pixel_size
    if chosen != "AUTO":
        return int(chosen)
    return 2 if context.preferences.system.pixel_size > 1.5 else 1


def _message(outcome: Outcome) -> str:
    if outcome.error is None:
        return ""
    if isinstance(outcome.error, LiveHandError):
        return str(outcome.error)
    LOGGER.error("The viewport's picture failed", exc_info=outcome.error)
    return f"stopped on an unexpected {type(outcome.error).__name__}: {outcome.error}"
