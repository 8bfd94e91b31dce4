"""A whole lit frame as one sequence of launches, from the parameters of a shot to its pixels.

Lists have capacities, and counters on the device say how much of them is filled: nothing waits for the host. Where a
list overflows, a flag says so that comes back with the pixels, and the frame must be rendered stage by stage.
"""

from __future__ import annotations

from typing import Any

import warp as wp

from ...surface.detail_mesh import SAMPLES
from ..whole_frames import LitModel, LitShot, ShotPixels
from .blocks import Layout
from .frame_buffers import FrameBuffers, Layouts, LitBuffers, answer_layout, padded_layout
from .frame_image import add_colours, add_coverage, add_pixels, add_superres
from .frame_light import add_decoder, add_light, add_shadows
from .frame_model import DeviceModel, lit_tables, precision_on
from .frame_parameters import fill_parameters, parameter_layout
from .frame_pose import add_pose, add_views
from .frame_rays import add_rays
from .frame_shape import FrameShape
from .kept_frames import KeptFrames
from .ray_stages import CAPACITY


class LitFrame:
    """Frames of one shape: buffers, and the sequence over them."""

    def __init__(self, on_device: DeviceModel[LitModel], shape: FrameShape) -> None:
        model = on_device.model
        layouts = lit_layouts(parameter_layout(model, shape), model, shape, precision_on(on_device.device))
        frame: LitBuffers = FrameBuffers(on_device, shape, layouts, CAPACITY)
        self.buffers, self._last = frame, None
        frame.add_begin()
        add_pose(frame)
        add_views(frame)
        add_rays(frame)
        add_shadows(frame)
        add_decoder(frame)
        add_light(frame)
        add_coverage(frame)
        add_superres(frame)
        add_pixels(frame)
        add_colours(frame)
        frame.add_end()

    def render(self, shot: LitShot) -> ShotPixels | None:
        """Render a frame, as `LitFrameRenderer.render`; None: a list has overflowed."""
        frame = self.buffers
        fill_parameters(frame.host, frame.model, frame.shape, shot, self._last)
        self._last = shot
        return frame.rendered()


def lit_frames(model: LitModel, device: str) -> KeptFrames[LitShot, FrameShape, ShotPixels]:
    """Return what renders lit frames of a model in any shape."""
    on_device = DeviceModel.of(model, lit_tables(model), device)
    return KeptFrames(lambda shot: FrameShape.of(shot), lambda shape: LitFrame(on_device, shape))


def lit_layouts(parameters: Layout, model: LitModel, shape: FrameShape, half: Any) -> Layouts:
    """Lay out lit frames."""
    pixels, hair = 4 * shape.rays, 4 * shape.rays if shape.has_hairs else 0
    words = {name: (wp.uint64, (shape.rays,)) for name in ("shown_low", "shown_mesh", "shown_outer")}
    zeros: Layout = {
        "counts": (wp.int32, (3,)),
        "has_overflow": (wp.int32, (1,)),
        "farthest_bits": (wp.int32, (1,)),
        "crossings": (wp.int32, (shape.rays,)),
        "sample_bits": (wp.int32, (pixels,)),
        "values": (wp.float32, (pixels, 18)),
        "alphas": (wp.float32, (pixels,)),
        "colours": (wp.vec3, (pixels,)),
        "longest_bits": (wp.int32, (1,)),
        "hair_sums": (wp.int64, (hair, 4)),
        "maps34": (wp.float32, (shape.rays, model.superres.head.in_channels)),
        **padded_layout(shape, half),
    }
    nothing: Layout = {
        **words,
        "shown": (wp.uint64, (pixels,)),
        "samples": (wp.uint64, (shape.edges * len(SAMPLES),)),
        "row": (wp.int32, (shape.rays,)),
        "slot": (wp.int32, (pixels,)),
    }
    infinity: Layout = {
        "stop_bits": (wp.int32, (shape.rays,)),
        "shadow_maps": (wp.int32, (shape.map_cells,)),
        "bounds": (wp.int32, (shape.views, 4)),
        "depth_of_rays": (wp.float32, (shape.rays,)),
        "hair_depth_bits": (wp.int32, (hair,)),
    }
    return Layouts(parameters, answer_layout(shape), zeros, nothing, infinity)
