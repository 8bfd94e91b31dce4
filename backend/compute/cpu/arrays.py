"""Tensors as the kernels take them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from torch import Tensor


def as_arrays(*values: Tensor) -> list[np.ndarray]:
    """Return contiguous arrays without gradients; of the tensors' own memory where they are contiguous."""
    return [_as_array(value) for value in values]


def _as_array(value: Tensor) -> np.ndarray:
    """Convert a tensor; a frame asks for hundreds: what there is nothing to do for is asked first."""
    if value.requires_grad:
        value = value.detach()
    return (value if value.is_contiguous() else value.contiguous()).numpy()


def whole_rows(values: Float[Tensor, "K P"]) -> np.ndarray:
    """Convert as `as_arrays`; where these are the first columns of a matrix, all of it, which need not be copied."""
    is_first = values.storage_offset() == 0 and values.numel() > 0
    is_slice = is_first and values.stride(1) == 1 and values.stride(0) > values.shape[1]
    return as_arrays(values.as_strided((len(values), values.stride(0)), values.stride()) if is_slice else values)[0]


def row_of(pixel: Int[Tensor, " P"], count: int) -> np.ndarray:
    """Find the row [count] int32 of each pixel of an image of that size among these, -1 for none."""
    row = np.full(count, -1, np.int32)
    row[pixel.numpy()] = np.arange(len(pixel), dtype=np.int32)
    return row
