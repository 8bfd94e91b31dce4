"""Tensors as the kernels take them."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from torch import Tensor


def as_arrays(*values: Tensor) -> list[np.ndarray]:
    """Contiguous, without gradients; of the tensors' own memory where they are contiguous."""
    return [value.detach().contiguous().numpy() for value in values]


def row_of(pixel: Int[Tensor, " P"], count: int) -> np.ndarray:
    """[count] int32 where each pixel of an image of that size stands among these, -1 for none."""
    row = np.full(count, -1, np.int32)
    row[pixel.numpy()] = np.arange(len(pixel), dtype=np.int32)
    return row
