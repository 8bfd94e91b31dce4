"""The memory of lit frames of one shape on a device: their parameters, the tables of their model, and all between."""

from __future__ import annotations

from typing import Any

import warp as wp

from ...surface.detail_mesh import SAMPLES
from ..lit_frames import FrameModel
from .blocks import Block, HostBlock, Layout
from .frame_model import DeviceModel, precision_on
from .frame_parameters import FrameShape, parameter_layout
from .kernels.compiled import INFINITE_BITS
from .kernels.tiles import ROWS
from .sequence import Sequence

OUT_CHANNELS = 5
RAYS, COVERED, EDGES = range(3)
"""Counters of what is listed."""


class FrameBuffers:
    """What frames of one shape share.

    Attributes:
        model: of the frames.
        shape: of the frames.
        device: Warp's name of it.
        sequence: to which launches are added.
        has_tiles: whether networks are products of tiles, in half precision.
        networks: in the device's precision.
        capacity: crossings of the inflated mesh that a ray's list holds.
        host: parameters, to be filled.
        answer: pixels and what overflowed, to be read.
    """

    def __init__(self, on_device: DeviceModel, shape: FrameShape, capacity: int) -> None:
        model, self.device, self._tables, self.networks = on_device
        device = self.device
        self.model, self.shape, self.sequence, self.capacity = model, shape, Sequence(device), capacity
        self.has_tiles, self.half = wp.get_device(device).is_cuda, precision_on(device)
        parameters, answer = parameter_layout(model, shape), _answer_layout(shape)
        block, pixels = Block(parameters, device), Block(answer, device)
        self.host, self.answer = HostBlock(block, parameters), HostBlock(pixels, answer)
        self._new = dict[str, wp.array]()
        self._cleared = [
            (Block(layout, device), layout, value)
            for layout, value in (
                (_of_zeros(model, shape, self.half), 0),
                (_of_nothing(shape), -1),
                (_of_infinity(shape), INFINITE_BITS),
            )
        ]
        self._blocks = [(block, parameters), (pixels, answer), *[one[:2] for one in self._cleared]]

    def __getitem__(self, name: str) -> wp.array:
        """Return a table, a parameter, or what was made by `new`."""
        for block, layout in self._blocks:
            if name in layout:
                return block[name]
        return self._new[name] if name in self._new else self._tables[name]

    def of(self, *names: str) -> tuple[wp.array, ...]:
        """Return several, in order."""
        return tuple(self[name] for name in names)

    def new(self, name: str, kind: Any, *shape: int) -> wp.array:
        """Make an array that every frame fills before it is read."""
        self._new[name] = wp.zeros(shape, dtype=kind, device=self.device)
        return self._new[name]

    def named(self, name: str, array: wp.array) -> wp.array:
        """Give a name to an array, such as a part of another."""
        self._new[name] = array
        return array

    def add(self, kernel: Any, dim: int | tuple[int, ...], *arguments: Any) -> None:
        """Add a launch; of its arguments, names stand for arrays."""
        given = (self[one] if isinstance(one, str) else one for one in arguments)
        self.sequence.add(kernel, dim, *given)

    def add_begin(self) -> None:
        """Begin a frame: copy its parameters, and clear what launches lower, raise or list."""
        self.sequence.then(self.host.upload)
        for block, _, value in self._cleared:
            self.sequence.fill(block.words, value)

    def add_end(self) -> None:
        """End a frame: copy its pixels to the host, and whether a list has overflowed."""
        self.sequence.then(lambda: wp.copy(self["overflow"], self["has_overflow"]))
        self.sequence.then(self.answer.download)

    @property
    def lanes(self) -> int:
        """Threads that share the pixels of a face of the hand's own mesh."""
        return 32 if wp.get_device(self.device).is_cuda else 1

    @property
    def image_rows(self) -> int:
        """Rows of a low-resolution image with a border, and of what tiles and shifts may reach beyond it."""
        width, height = self.shape.size_px
        return (height + 4) * (width + 2) + int(ROWS)


def _answer_layout(shape: FrameShape) -> Layout:
    return {"pixels": (wp.float32, (4 * shape.rays, OUT_CHANNELS)), "overflow": (wp.int32, (1,))}


def _of_zeros(model: FrameModel, shape: FrameShape, half: Any) -> Layout:
    """Lay out what a frame clears to zeros."""
    width, height = shape.size_px
    maps = model.superres.head.in_channels
    rows = (height + 4) * (width + 2) + int(ROWS)
    return {
        "counts": (wp.int32, (3,)),
        "has_overflow": (wp.int32, (1,)),
        "farthest_bits": (wp.int32, (1,)),
        "crossings": (wp.int32, (shape.rays,)),
        "sample_bits": (wp.int32, (4 * shape.rays,)),
        "values": (wp.float32, (4 * shape.rays, 18)),
        "alphas": (wp.float32, (4 * shape.rays,)),
        "colours": (wp.vec3, (4 * shape.rays,)),
        "maps34": (wp.float32, (shape.rays, maps)),
        "padded": (half, (rows, 64)),
    }


def _of_nothing(shape: FrameShape) -> Layout:
    """Lay out what a frame clears to -1: words of no face, and lists' places of what is in none."""
    words = {name: (wp.uint64, (shape.rays,)) for name in ("shown_low", "shown_mesh", "shown_outer")}
    return {
        **words,
        "shown": (wp.uint64, (4 * shape.rays,)),
        "samples": (wp.uint64, (shape.edges * len(SAMPLES),)),
        "row": (wp.int32, (shape.rays,)),
        "slot": (wp.int32, (4 * shape.rays,)),
    }


def _of_infinity(shape: FrameShape) -> Layout:
    """Lay out what a frame clears to infinite depths, in bits or as they are."""
    return {
        "stop_bits": (wp.int32, (shape.rays,)),
        "shadow_maps": (wp.int32, (shape.map_cells,)),
        "bounds": (wp.int32, (shape.views, 4)),
        "depth_of_rays": (wp.float32, (shape.rays,)),
    }
