"""The end of a frame: as `surface.edge_antialiasing.blended` and `image.decode.linear_frame`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from ....image.decode import MIN_ALPHA
from ....records.frame import DEPTH_BACKGROUND
from .compiled import Bools2, Floats, Floats2, Ints, Vectors, kernel
from .edges import blended_colour

_MIN_ALPHA, _BACKGROUND = wp.constant(MIN_ALPHA), wp.constant(DEPTH_BACKGROUND)


@kernel
@no_type_check
def develop_pixels(
    colours: Vectors,
    alpha: Floats,
    depth: Floats,
    width: int,
    slot: Ints,
    slots: int,
    shows_first: Bools2,
    share: Floats,
    out: Floats2,
):
    """Fill out [H * W, 5]: premultiplied scene-linear RGB, alpha, and depth, m; `slot`: its place among edges."""
    pixel = wp.tid()
    opacity = wp.min(alpha[pixel], 1.0)
    if opacity <= _MIN_ALPHA:
        opacity = wp.float32(0.0)
    colour = wp.vec3()
    if opacity > 0.0:
        colour = colours[pixel]
        edge = slot[pixel]
        if edge >= 0 and edge < slots:
            colour = blended_colour(colours, alpha, depth, width, pixel, shows_first, share, edge)
    for axis in range(3):
        out[pixel, axis] = colour[axis]
    out[pixel, 3] = opacity
    out[pixel, 4] = _BACKGROUND
    if opacity >= 0.5 and wp.isfinite(depth[pixel]):
        out[pixel, 4] = depth[pixel]
