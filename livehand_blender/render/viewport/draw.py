"""Draws images and messages into a 3D view, in pixels of its region.

An engine draws scene-linear colours; Blender applies the view transform to the whole view afterwards.
"""

from __future__ import annotations

import textwrap

import blf
import gpu
from gpu_extras.batch import batch_for_shader

from .image import ViewportImage
from .view import Rectangle

_FONT = 0
_TEXT_PT = 12.0
_MARGIN_PX = 20.0
_TRIANGLES = ((0, 1, 2), (0, 2, 3))
_WHITE, _SHADE = (1.0, 1.0, 1.0, 1.0), (0.0, 0.0, 0.0, 0.7)


class ImageTexture:
    """An image on the GPU; created and drawn only in Blender's drawing callbacks."""

    def __init__(self, image: ViewportImage):
        height, width, _ = image.rgba.shape
        pixels = gpu.types.Buffer("FLOAT", image.rgba.size, image.rgba.ravel())
        self._texture = gpu.types.GPUTexture((width, height), format="RGBA16F", data=pixels)
        self._box = image.box

    def draw(self, rectangle: Rectangle, region_height_px: int) -> None:
        """Draw the image over a rectangle of the region."""
        left, top, right, bottom = self._box
        left, right = rectangle.left + left, rectangle.left + right
        top, bottom = (region_height_px - rectangle.top - edge for edge in (top, bottom))
        shader = gpu.shader.from_builtin("IMAGE")
        quad = {"pos": _corners(left, bottom, right, top), "texCoord": _corners(0, 0, 1, 1)}
        batch = batch_for_shader(shader, "TRIS", quad, indices=_TRIANGLES)
        gpu.state.blend_set("ALPHA_PREMULT")
        shader.uniform_sampler("image", self._texture)
        batch.draw(shader)
        gpu.state.blend_set("NONE")


def draw_message(text: str, width_px: int, scale: float) -> None:
    """Draw text on a dark box in the lower left of a region, wrapped to its width; `scale` is the interface's."""
    blf.size(_FONT, _TEXT_PT * scale)
    letter_px, line_px = blf.dimensions(_FONT, "n")[0], 1.6 * _TEXT_PT * scale
    margin_px = _MARGIN_PX * scale
    lines = textwrap.wrap(text, max(20, int((width_px - 4 * margin_px) / letter_px)))
    _draw_box(
        (margin_px / 2, margin_px / 2),
        (max(blf.dimensions(_FONT, line)[0] for line in lines) + 1.5 * margin_px, (len(lines) + 1) * line_px),
    )
    blf.color(_FONT, *_WHITE)
    for number, line in enumerate(reversed(lines)):
        blf.position(_FONT, margin_px, margin_px + number * line_px, 0)
        blf.draw(_FONT, line)


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
