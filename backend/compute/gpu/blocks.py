"""Named arrays side by side in one piece of a device's memory: cleared, or copied from or to the host, at once."""

from __future__ import annotations

from collections.abc import Mapping
from math import prod
from typing import Any

import numpy as np
import warp as wp

Layout = Mapping[str, tuple[Any, tuple[int, ...]]]
"""Name -> (Warp's type of an element, shape)."""
_ALIGNED_BYTES = 64


class DeviceBlock:
    """Arrays of a layout.

    Attributes:
        words: all of it, as whole numbers.
    """

    def __init__(self, layout: Layout, device: str, pinned: bool = False) -> None:
        starts, end = {}, 0
        for name, (kind, shape) in layout.items():
            starts[name] = end
            end += -(-prod(shape) * wp.types.type_size_in_bytes(kind) // _ALIGNED_BYTES) * _ALIGNED_BYTES
        self.words = wp.zeros(max(end, _ALIGNED_BYTES) // 4, dtype=wp.int32, device=device, pinned=pinned)
        self._arrays = {
            name: wp.array(ptr=self.words.ptr + starts[name], dtype=kind, shape=shape, device=device)
            for name, (kind, shape) in layout.items()
        }

    def __getitem__(self, name: str) -> wp.array:
        """Return an array of the layout."""
        return self._arrays[name]


class HostBlock:
    """The host's twin of a block, by which it is filled or read at once; pinned where there is a GPU."""

    def __init__(self, block: DeviceBlock, layout: Layout) -> None:
        device = block.words.device
        self._block, is_cuda = block, device is not None and device.is_cuda
        self._twin = DeviceBlock(layout, "cpu", pinned=is_cuda)
        self._values = {name: self._twin[name].numpy() for name in layout}

    def __getitem__(self, name: str) -> np.ndarray:
        """Return the memory of an array, to be read or written."""
        return self._values[name]

    def upload(self) -> None:
        """Copy all to the device."""
        wp.copy(self._block.words, self._twin.words)

    def download(self) -> None:
        """Copy all from the device; on a GPU, when its stream comes to it."""
        wp.copy(self._twin.words, self._block.words)


def address_of(array: wp.array) -> int:
    """Return where an array's memory begins; 0 of an empty one."""
    return array.ptr or 0


def stride_of(array: wp.array) -> int:
    """Return the bytes from a row of an array to the next."""
    strides = array.strides
    assert strides is not None
    return int(strides[0] or 0)


def columns_of(rows: wp.array, first: int, kind: Any, shape: tuple[int, ...]) -> wp.array:
    """Return some columns of rows [R, C] of floats as an array [R, *shape] of vectors or floats, without a copy."""
    step = wp.types.type_size_in_bytes(kind)
    inner = [step * prod(shape[axis + 1 :]) for axis in range(len(shape))]
    return wp.array(
        ptr=address_of(rows) + 4 * first,
        dtype=kind,
        shape=(rows.shape[0], *shape),
        strides=(stride_of(rows), *inner),
        device=rows.device,
    )


def part_of_rows(array: wp.array, first: int, count: int) -> wp.array:
    """Return rows of an array from `first` on, without a copy."""
    strides = array.strides
    assert strides is not None
    shape, steps = (count, *array.shape[1:]), tuple(int(one or 0) for one in strides)
    at = address_of(array) + first * stride_of(array)
    return wp.array(ptr=at, dtype=array.dtype, shape=shape, strides=steps, device=array.device)


def part_of(array: wp.array, first: int, count: int) -> wp.array:
    """Return elements of an array [N] from `first` on, without a copy."""
    at = address_of(array) + first * stride_of(array)
    return wp.array(ptr=at, dtype=array.dtype, shape=(count,), device=array.device)
