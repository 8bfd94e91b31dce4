"""The memory of lit frames of one shape on a device, and the launches over it in a fixed order.

Launches run one by one, or on a GPU are recorded once and then started at once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import warp as wp
from torch import Tensor

from ..whole_frames import LitModel, ShotPixels
from .blocks import DeviceBlock, HostBlock, Layout
from .frame_model import DeviceModel, Model, device_array, precision_on
from .frame_shape import FrameShape, ImageShape
from .kernels.compiled import INFINITE_BITS
from .kernels.tiles import ROWS, THREADS

_PIXELS = {"rgb": wp.vec3, "pixel_alpha": wp.float32, "pixel_depth": wp.float32}
RAYS, COVERED, EDGES = range(3)
"""Counters of what is listed."""


class Sequence:
    """Launches on a device, whose arrays it keeps alive.

    Attributes:
        device: Warp's name of it.
        kernels: the names of the kernels, in order.
    """

    def __init__(self, device: str) -> None:
        self.device, self.kernels = device, list[str]()
        self._steps, self._kept = list[Callable[[], Any]](), list[Any]()
        self._graph = None

    def add(self, kernel: Any, dim: int | tuple[int, ...], *arguments: Any) -> None:
        """Add a launch; a launch for nothing is left out."""
        sizes = (dim,) if isinstance(dim, int) else dim
        if min(sizes) > 0:
            given = {"inputs": list(arguments), "device": self.device, "record_cmd": True}
            self._append(kernel, wp.launch(kernel, dim, **given), arguments)

    def add_tiles(self, kernel: Any, dim: tuple[int, ...], *arguments: Any) -> None:
        """Add a launch of a kernel of tiles."""
        given = {"inputs": list(arguments), "device": self.device, "record_cmd": True}
        self._append(kernel, wp.launch_tiled(kernel, dim, block_dim=THREADS, **given), arguments)

    def fill(self, words: wp.array, value: int) -> None:
        """Add the filling of an array with a number; zero, and -1, cost least."""
        self._steps.append((lambda: words.zero_()) if value == 0 else (lambda: words.fill_(value)))

    def then(self, step: Callable[[], None]) -> None:
        """Add a step that only starts work on the device."""
        self._steps.append(step)

    def run(self) -> None:
        """Start all; on a GPU from the second time on as one recorded graph. Nothing is waited for."""
        if self._graph is not None:
            wp.capture_launch(self._graph)
            return
        for step in self._steps:
            step()
        if wp.get_device(self.device).is_cuda:
            self._graph = self.recorded()

    def recorded(self) -> Any:
        """Record all as a graph, without running it."""
        with wp.ScopedCapture(device=self.device, force_module_load=False) as capture:
            for step in self._steps:
                step()
        return capture.graph

    def _append(self, kernel: Any, command: Any, arguments: tuple[Any, ...]) -> None:
        self.kernels.append(kernel.key)
        self._steps.append(command.launch)
        self._kept.append(arguments)


Shape = TypeVar("Shape", bound=ImageShape)


class Layouts(NamedTuple):
    """What of a frame lies side by side.

    Attributes:
        parameters: that the host fills.
        answer: that the host reads.
        zeros: that a frame clears to zeros.
        nothing: that it clears to -1, words of no face, and lists' places of what is in none.
        infinity: that it clears to infinite depths, in bits or as they are.
    """

    parameters: Layout
    answer: Layout
    zeros: Layout
    nothing: Layout
    infinity: Layout


class FrameBuffers(Generic[Model, Shape]):
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
        filled: the names of what was made by `new`.
    """

    def __init__(self, on_device: DeviceModel[Model], shape: Shape, layouts: Layouts, capacity: int) -> None:
        self.model: Model = on_device.model
        self.shape: Shape = shape
        self.device, self._tables, self.networks = on_device.device, on_device.tables, on_device.networks
        device = self.device
        self.sequence, self.capacity = Sequence(device), capacity
        self.has_tiles, self.half = wp.get_device(device).is_cuda, precision_on(device)
        parameters, answer = layouts[:2]
        block, pixels = DeviceBlock(parameters, device), DeviceBlock(answer, device)
        self.host, self.answer = HostBlock(block, parameters), HostBlock(pixels, answer)
        self.filled, self._named = list[str](), dict[str, wp.array]()
        self._cleared = [
            (DeviceBlock(layout, device), layout, value)
            for layout, value in zip(layouts[2:], (0, -1, INFINITE_BITS), strict=True)
        ]
        self._blocks = [(block, parameters), (pixels, answer), *[one[:2] for one in self._cleared]]

    def __getitem__(self, name: str) -> wp.array:
        """Return a table, a parameter, or what was made by `new`."""
        for block, layout in self._blocks:
            if name in layout:
                return block[name]
        return self._named[name] if name in self._named else self._tables[name]

    def of(self, *names: str) -> tuple[wp.array, ...]:
        """Return several, in order."""
        return tuple(self[name] for name in names)

    def new(self, name: str, kind: Any, *shape: int) -> wp.array:
        """Make an array that every frame fills before it is read; no table or parameter may have its name."""
        assert not any(name in known for known in (self._tables, *(layout for _, layout in self._blocks))), name
        self.filled.append(name)
        return self.named(name, wp.zeros(shape, dtype=kind, device=self.device))

    def constant(self, name: str, values: Tensor | np.ndarray, kind: Any) -> wp.array:
        """Copy an array that no frame changes."""
        return self.named(name, device_array(values, kind, self.device))

    def named(self, name: str, array: wp.array) -> wp.array:
        """Give a name to an array, such as a part of another."""
        self._named[name] = array
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

    def rendered(self) -> ShotPixels | None:
        """Run the sequence, wait for it, and return its pixels, which are valid until the next; None: an overflow."""
        self.sequence.run()
        wp.synchronize_device(self.device)
        if self.answer["overflow"][0]:
            return None
        width, height = self.shape.size_px
        size = 2 * height, 2 * width
        rgb, alpha, depth = (self.answer[name] for name in ("rgb", "pixel_alpha", "pixel_depth"))
        return ShotPixels(rgb.reshape(*size, 3), alpha.reshape(size), depth.reshape(size))

    @property
    def lanes(self) -> int:
        """Threads that share the pixels of a face of the hand's own mesh."""
        return 32 if wp.get_device(self.device).is_cuda else 1

    @property
    def image_rows(self) -> int:
        """Rows of a low-resolution image with a border, and of what tiles and shifts may reach beyond it."""
        width, height = self.shape.size_px
        return (height + 4) * (width + 2) + int(ROWS)


LitBuffers = FrameBuffers[LitModel, FrameShape]
"""Those of lit frames."""


def answer_layout(shape: ImageShape) -> Layout:
    """Lay out a frame's pixels, and whether a list has overflowed."""
    of_pixels = {name: (kind, (4 * shape.rays,)) for name, kind in _PIXELS.items()}
    return {**of_pixels, "overflow": (wp.int32, (1,))}


def padded_layout(shape: ImageShape, half: Any) -> Layout:
    """Lay out the maps of rays with a border, which super-resolution is given."""
    width, height = shape.size_px
    return {"padded": (half, ((height + 4) * (width + 2) + int(ROWS), 64))}
