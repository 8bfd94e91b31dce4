"""Points and directions in the frames of bones.

A frame [4, 4] maps bone coordinates to the world; its upper left is orthogonal, and a reflection where a hand is seen
as its mirror image.
"""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor


def points_in_bones(points: Float[Tensor, "*n 3"], frames: Float[Tensor, "K 4 4"]) -> Float[Tensor, "*n K 3"]:
    """Compute world points in each bone's frame, m."""
    return directions_in_bones(points[..., None, :] - frames[:, :3, 3], frames)


def directions_in_bones(directions: Float[Tensor, "*n K 3"], frames: Float[Tensor, "K 4 4"]) -> Float[Tensor, "*n K 3"]:
    """Compute world directions, one for each bone, in its frame."""
    return torch.einsum("...ki,kij->...kj", directions, frames[:, :3, :3])
