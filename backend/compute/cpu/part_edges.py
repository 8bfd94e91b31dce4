"""Pixels that show two parts, on the CPU: as `surface.part_edges`, by the kernel."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ...image.relighting import MIN_ALPHA
from ...surface.part_edges import PartEdges
from ..kernels.part_edges import blend_parts
from .arrays import as_arrays
from .threads import in_parallel


def blended(
    colours: Float[Tensor, "3 H W"], alpha: Float[Tensor, "H W"], depth: Float[Tensor, "H W"], edges: PartEdges
) -> Float[Tensor, "3 H W"]:
    """As `surface.part_edges.blended`."""
    pixels, mixed = colours.permute(1, 2, 0).flatten(0, 1), torch.empty(len(edges.pixel), 3)
    image, out = as_arrays(pixels, alpha.flatten(), depth.flatten()), mixed.numpy()
    what = (*image, depth.shape[1], tuple(as_arrays(*edges)), np.float32(MIN_ALPHA))
    in_parallel(lambda first, last: blend_parts(*what, first, last, out), len(mixed))
    return pixels.index_put((edges.pixel,), mixed).T.reshape(colours.shape)
