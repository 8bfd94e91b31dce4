"""A 3D view in Rendered shading: the engine calls `update` when the scene changes and `draw` at every redraw."""

from __future__ import annotations

import logging
import textwrap
import time
from collections.abc import Sequence
from typing import NamedTuple

import blf
import bpy
import gpu
from gpu_extras.batch import batch_for_shader

from ...backend.records.errors import LiveHandError
from ...backend.render.frame_task import is_equal
from ...backend.system.memory import memory_message
from ..hands.visible_hands import InstanceId, VisibleHand, visible_hands
from ..light.foreground import Foreground
from ..light.solids import LocalTriangles
from ..light.studio import needs_light
from ..scene.colour import rec709_to_working_space
from .hand_source import drawing_note
from .viewport_hand import ViewportHand, read_viewport_hands
from .viewport_image import Pace, ViewportImage, ViewportRequest, ViewportStep
from .viewport_shared import ViewportShared
from .viewport_view import Rectangle, RegionView, read_view

LOGGER = logging.getLogger(__name__)

_FONT = 0
_TEXT_PT = 12.0
_MARGIN_PX = 20.0
_NO_LIGHT = "no light falls on the hands; press Studio Lights in the LiveHand tab of the sidebar (N)"
_BLENDERS_LINES = 5  # that Blender may write there itself
_WHITE = (1.0, 1.0, 1.0, 1.0)
BAND_PX = 1 << 18
"""Pixels that are uploaded at a time: 2 to 3 ms where a processor stands for the GPU."""
_LONGEST_S = 0.004
"""Past this, a drawing begins no other band."""
_TRIANGLES = ((0, 1, 2), (0, 2, 3))
_SHADE = (0.0, 0.0, 0.0, 0.7)


def viewport_of(engine) -> Viewport:
    """Return the engine's viewport, made at the first call: not every engine that Blender makes is for a view."""
    if not hasattr(engine, "viewport"):
        engine.viewport = Viewport(type(engine).viewport_shared)
    return engine.viewport


class Viewport:
    """One 3D view, owned by the engine that Blender makes for it; it refers to no Blender object once it has read them.

    Attributes:
        has_image: whether the hands are drawn; if not, their meshes stand for them in Cycles' preview.
        has_failed: whether they cannot be drawn; else their image is there, or comes.
    """

    def __init__(self, shared: ViewportShared):
        self._shared = shared
        self._hands: tuple[ViewportHand, ...] = ()
        self._problem = ""  # why the hands cannot be read
        self._submitted: tuple[ViewportRequest, float, bool] | None = None
        self._pace = Pace()
        self._images = UploadedImages()
        self.has_image = False
        self.has_failed = False
        self._is_at_once = False  # the newest image was rendered as what moves is, and needs no other
        self._is_stale = True  # the scene has changed since it was read
        self._visible: tuple[VisibleHand, ...] | None = None  # of the changed scene, from its update to its reading
        self._triangles = LocalTriangles()
        self._foreground: Foreground | None = None
        self._message = ""  # the outcome of the last request, if it is not an image
        self._has_error = False  # it is an error
        self._hint = ""  # what to do about an image that is there

    @property
    def is_uploading(self) -> bool:
        """Whether the next drawing has more of an image to upload."""
        return self._images.is_uploading

    def update(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Note that the scene has changed."""
        self._is_stale, self._visible = True, None
        self._triangles.forget_changed(depsgraph)

    def hand_meshes(self, depsgraph: bpy.types.Depsgraph) -> tuple[InstanceId, ...]:
        """List the meshes of all hands of a changed scene, which are read once for this and for the drawing.

        Raises:
            LiveHandError: a hand of the scene has no mesh.
        """
        self._visible = _drawn_hands(depsgraph)
        return tuple(hand.instance_id for hand in self._visible)

    def draw(self, engine: bpy.types.RenderEngine, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        """Submit the view's request if it has changed, and draw the newest image."""
        # Of the frames of an animation, only those are read that will be shown: one while the one before is rendered.
        if self._is_stale and not self._shared.preview.is_waiting(self):
            self._read(context, depsgraph)
        message, has_failed = self._problem, bool(self._problem)
        if not message:
            try:
                message = self._draw_view(engine, context, depsgraph, read_view(context, depsgraph))
                has_failed = self._has_error
            except Exception as error:  # raised to Blender, it would keep the engine alive, and Cycles would crash
                message, has_failed = _message_of(error), True
        has_image = not message and (self._images.shown is not None or self._images.is_empty)
        if (has_image, has_failed) != (self.has_image, self.has_failed):
            self.has_image, self.has_failed = has_image, has_failed
            self._shared.timer.update_meshes()
        if shown := message or self._hint:
            draw_message(f"LiveHand: {shown}", free_area(context), context.preferences.system.ui_scale)

    def _read(self, context: bpy.types.Context, depsgraph: bpy.types.Depsgraph) -> None:
        self._is_stale = False
        self._foreground = None
        self._triangles.forget_unasked()
        self._hint = _NO_LIGHT if needs_light(depsgraph.scene, depsgraph.view_layer) else ""
        try:
            visible = _drawn_hands(depsgraph) if self._visible is None else self._visible
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
        if preparing := self._shared.preparation.progress:  # of the same kernels, here a second time
            return preparing.text
        self._submit(engine, depsgraph, view, 1 / _pixel_size(context), context.screen.is_animation_playing)
        self._receive()
        if self._images.upload():
            self._shared.timer.watch(self, engine)
        if self._images.shown:
            self._images.shown.draw(view.rectangle, context.region.height)
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
        if waits_for := _loading(self._hands, self._submitted and self._submitted[0].hands):
            self._message = waits_for
        self._submitted = request, scale, is_playing
        moving_px = self._pace.side_px
        moving_scale = min(scale, moving_px / max(request.camera.size_px))
        at_once = scale if self._pace.keeps_whole else None
        moving = ViewportStep(request, self._shared.session, moving_scale, moving_px, at_once)
        still = ViewportStep(request, self._shared.session, scale)
        is_alone = is_playing or (self._is_at_once and at_once is not None)
        self._shared.preview.submit(self, [moving] if is_alone else [moving, still])
        self._shared.timer.watch(self, engine)

    def _receive(self) -> None:
        outcome = self._shared.preview.pop_outcome(self)
        if outcome is not None:
            step = outcome.step
            if isinstance(step, ViewportStep) and outcome.value is not None:
                self._is_at_once = outcome.value.is_at_once
                if self._is_at_once:
                    self._pace.record_whole(outcome.seconds)
                elif step.moving_px is not None:
                    self._pace.record(step.moving_px, outcome.seconds)
            self._has_error = outcome.error is not None
            if outcome.error:
                self._message = _message_of(outcome.error)
            elif isinstance(step, ViewportStep) and self._submitted:  # which may have an avatar more
                self._message = _loading(self._submitted[0].hands, step.request.hands)
            else:
                self._message = ""
            if isinstance(outcome.value, ViewportImage):
                self._images.add(outcome.value)
            else:
                self._images.clear(is_empty=not outcome.error)


def _drawn_hands(depsgraph: bpy.types.Depsgraph) -> tuple[VisibleHand, ...]:
    """Find the hands that are drawn over the view: the holes of holdouts are Cycles', of their meshes."""
    return tuple(hand for hand in visible_hands(depsgraph) if not hand.is_holdout)


def _loading(hands: Sequence[ViewportHand], shown: Sequence[ViewportHand] | None) -> str:
    """Tell what views wait for: any avatar at first (None), later the people of numbers alone; empty: nothing long."""
    known = {hand.source.avatar_path for hand in shown or ()}
    if drawing := drawing_note(hand.source.avatar_path for hand in hands if hand.source.avatar_path not in known):
        return drawing
    return "loading the avatar" if hands and shown is None else ""


def _pixel_size(context: bpy.types.Context) -> int:
    """Return the screen pixels along a rendered pixel's side: the scene's *Pixel Size*, read as Cycles reads it."""
    chosen = context.scene.render.preview_pixel_size
    if chosen != "AUTO":
        return int(chosen)
    return 2 if context.preferences.system.pixel_size > 1.5 else 1


def _message_of(error: Exception) -> str:
    if isinstance(error, LiveHandError):
        return str(error)
    if message := memory_message(error):
        return message
    LOGGER.error("The 3D view failed", exc_info=error)
    return f"stopped on an unexpected {type(error).__name__}: {error}"


class FreeArea(NamedTuple):
    """What other regions leave of a 3D view's: left, right and top edges, px, rows counted from the bottom."""

    left: float
    right: float
    top: float


def free_area(context: bpy.types.Context) -> FreeArea:
    """Find the part of the view's region that headers, toolbar and sidebar do not cover.

    Blender writes the view's name and its render's state into the upper left, and *Adjust Last Operation* covers the
    lower left.
    """
    region, left, right = context.region, 0.0, float(context.region.width)
    top = float(context.region.height)
    if context.preferences.system.use_region_overlap:
        for other in (one for one in context.area.regions if one.width > 1 and one.height > 1):
            if other.type == "TOOLS":
                left = max(left, other.x + other.width - region.x)
            elif other.type == "UI":
                right = min(right, other.x - region.x)
            elif other.type in {"HEADER", "TOOL_HEADER"} and other.alignment != "BOTTOM":
                top = min(top, other.y - region.y)
    return FreeArea(left, right, top)


def draw_message(text: str, area: FreeArea, scale: float) -> None:
    """Draw text on a dark box in the upper left of an area, below Blender's own; `scale` is the interface's."""
    blf.size(_FONT, _TEXT_PT * scale)
    letter_px, line_px = blf.dimensions(_FONT, "n")[0], 1.6 * _TEXT_PT * scale
    margin_px = _MARGIN_PX * scale
    lines = textwrap.wrap(text, max(16, int((area.right - area.left - 4 * margin_px) / letter_px)))
    left, top = area.left + margin_px, area.top - _BLENDERS_LINES * line_px
    wide_px = max(blf.dimensions(_FONT, line)[0] for line in lines)
    _draw_box(
        (left - margin_px / 2, top - len(lines) * line_px - margin_px / 2),
        (left + wide_px + margin_px / 2, top + margin_px / 4),
    )
    blf.color(_FONT, *_WHITE)
    for number, line in enumerate(lines):
        blf.position(_FONT, left, top - (number + 1) * line_px + 0.3 * line_px, 0)
        blf.draw(_FONT, line)


class Band:
    """Rows of an image, from `first` to before `last`, with the neighbours that filters mix with them."""

    def __init__(self, image: ViewportImage, first: int, last: int):
        height, width, _ = image.rgba.shape
        start, end = max(first - 1, 0), min(last + 1, height)
        rows = image.rgba[start:end]
        pixels = gpu.types.Buffer("FLOAT", rows.size, rows.ravel())
        self.texture = gpu.types.GPUTexture((width, end - start), format=_texture_format(), data=pixels)
        self.shares = first / height, last / height
        self.coordinates = (first - start) / (end - start), (last - start) / (end - start)


def _texture_format() -> str:
    """Return the format that is uploaded as it is: halves are rounded by the processor, in two to four times as long.

    Not every GPU of Apple's mixes neighbours in single precision.
    """
    return "RGBA16F" if gpu.platform.backend_type_get() == "METAL" else "RGBA32F"


class ImageTexture:
    """An image on the GPU; uploaded and drawn only in Blender's drawing callbacks.

    Its colours are scene-linear: Blender applies the view transform to the whole view afterwards.
    """

    def __init__(self, image: ViewportImage):
        height, width, _ = image.rgba.shape
        self.image, self._bands = image, list[Band]()
        self._rows, self._missing = max(1, BAND_PX // width), height

    def upload(self, until_s: float) -> bool:
        """Upload bands until this time of `perf_counter`, one at least; returns whether all are there."""
        height = len(self.image.rgba)
        while self._missing:
            first = height - self._missing
            last = min(first + self._rows, height)
            self._bands.append(Band(self.image, first, last))
            self._missing = height - last
            if time.perf_counter() >= until_s:
                break
        return not self._missing

    def draw(self, rectangle: Rectangle, region_height_px: int) -> None:
        """Draw the image over a rectangle of the region."""
        left, top, right, bottom = self.image.box
        left, right = rectangle.left + left, rectangle.left + right
        top, bottom = (region_height_px - rectangle.top - edge for edge in (top, bottom))
        shader = gpu.shader.from_builtin("IMAGE")
        gpu.state.blend_set("ALPHA_PREMULT")
        for band in self._bands:
            low, high = (bottom + share * (top - bottom) for share in band.shares)
            first, last = band.coordinates
            quad = {"pos": _corners(left, low, right, high), "texCoord": _corners(0, first, 1, last)}
            batch = batch_for_shader(shader, "TRIS", quad, indices=_TRIANGLES)
            shader.uniform_sampler("image", band.texture)
            batch.draw(shader)
        gpu.state.blend_set("NONE")


class UploadedImages:
    """The image that a view shows, and those that are to follow.

    Attributes:
        shown: the newest that is whole; None: there is none.
        is_empty: whether the newest shows no hand.
    """

    def __init__(self) -> None:
        self.shown: ImageTexture | None = None
        self.is_empty = False
        self._coming: ImageTexture | None = None
        self._next: ViewportImage | None = None

    @property
    def is_uploading(self) -> bool:
        """Whether any image is to follow."""
        return self._coming is not None

    def add(self, image: ViewportImage) -> None:
        """Add a new image; it follows the one that is being uploaded, which so is shown however many come."""
        if self._coming is None:
            self._coming = ImageTexture(image)
        else:
            self._next = image

    def clear(self, is_empty: bool) -> None:
        """Show no image: of no hand, or of an error."""
        self.shown = self._coming = self._next = None
        self.is_empty = is_empty

    def upload(self) -> bool:
        """Upload what there is time for; returns whether more is to follow."""
        until_s = time.perf_counter() + _LONGEST_S
        while self._coming is not None and self._coming.upload(until_s):
            self.shown, self.is_empty = self._coming, False
            self._coming, self._next = None if self._next is None else ImageTexture(self._next), None
            if time.perf_counter() >= until_s:
                break
        return self.is_uploading


def _draw_box(first_px: tuple[float, float], last_px: tuple[float, float]) -> None:
    (left, bottom), (right, top) = first_px, last_px
    shader = gpu.shader.from_builtin("UNIFORM_COLOR")
    batch = batch_for_shader(shader, "TRIS", {"pos": _corners(left, bottom, right, top)}, indices=_TRIANGLES)
    gpu.state.blend_set("ALPHA")
    shader.uniform_float("color", _SHADE)
    batch.draw(shader)
    gpu.state.blend_set("NONE")


def _corners(left: float, bottom: float, right: float, top: float) -> tuple[tuple[float, float], ...]:
    return (left, bottom), (right, bottom), (right, top), (left, top)
