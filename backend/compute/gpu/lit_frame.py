"""A whole lit frame as one sequence of launches, from the parameters of a shot to its pixels.

Lists have capacities, and counters on the device say how much of them is filled: nothing waits for the host. Where a
list overflows, a flag says so that comes back with the pixels, and the frame must be rendered stage by stage.
"""

from __future__ import annotations

from collections import OrderedDict

import warp as wp

from ..lit_frames import FrameModel, LitShot, ShotPixels
from .frame_buffers import FrameBuffers
from .frame_image import add_colours, add_coverage, add_pixels, add_superres
from .frame_light import add_decoder, add_light, add_shadows
from .frame_model import DeviceModel
from .frame_parameters import fill_parameters
from .frame_pose import add_pose, add_views
from .frame_rays import add_rays
from .frame_shape import FrameShape
from .ray_stages import CAPACITY

_MOST_KEPT = 4
_NO_MEMORY = "Failed to allocate"  # as Warp says it


class LitFrame:
    """Frames of one shape: buffers, and the sequence over them."""

    def __init__(self, model: DeviceModel, shape: FrameShape) -> None:
        self.buffers, self._last = FrameBuffers(model, shape, CAPACITY), None
        frame = self.buffers
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
        frame.sequence.run()
        wp.synchronize_device(frame.device)
        if frame.answer["overflow"][0]:
            return None
        width, height = frame.shape.size_px
        size = 2 * height, 2 * width
        rgb, alpha, depth = (frame.answer[name] for name in ("rgb", "pixel_alpha", "pixel_depth"))
        return ShotPixels(rgb.reshape(*size, 3), alpha.reshape(size), depth.reshape(size))


class LitFrames:
    """Renders lit frames of a model in any shape, one at a time; it keeps the buffers of the last few."""

    def __init__(self, model: FrameModel, device: str) -> None:
        self._model = DeviceModel.of(model, device)
        self._kept = OrderedDict[FrameShape, LitFrame]()

    def render(self, shot: LitShot) -> ShotPixels | None:
        """Render a frame, as `LitFrameRenderer.render`; None where the device's memory is too full as well."""
        try:
            frame = self.of(FrameShape.of(shot))
        except RuntimeError as error:
            if _NO_MEMORY not in str(error):
                raise
            self._kept.clear()
            return None
        return frame.render(shot)

    def of(self, shape: FrameShape) -> LitFrame:
        """Return the frames of a shape."""
        if shape not in self._kept:
            while len(self._kept) >= _MOST_KEPT:
                self._kept.popitem(last=False)
            self._kept[shape] = LitFrame(self._model, shape)
        self._kept.move_to_end(shape)
        return self._kept[shape]
