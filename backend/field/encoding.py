"""Encodings of position: sines of growing frequency, and learned feature planes over the atlas."""

from __future__ import annotations

from collections.abc import Callable

import torch
from jaxtyping import Float
from torch import Tensor, nn


def positional_encoding(x: Float[Tensor, "*n C"], octaves: int) -> Float[Tensor, "*n D"]:
    """Return [x, sin(2^k x), cos(2^k x)], k = 0..octaves-1 (the paper's, without factor pi): D = C (1 + 2 octaves)."""
    scaled = x[..., None, :] * (2.0 ** torch.arange(octaves, device=x.device, dtype=x.dtype))[:, None]
    waves = torch.stack([scaled.sin(), scaled.cos()], -2)  # [..., octaves, 2, C]
    return torch.cat([x, waves.flatten(-3)], -1)


class FeaturePlane(nn.Module):
    """A square grid of features over the atlas, at a few heights of the shell.

    Bilinear in (u, v), linear in h. Texel centres lie at (i + 0.5) / resolution, as in any texture.
    """

    def __init__(self, resolution: int, heights: int, channels: int, init: float = 0.05):
        super().__init__()
        self.resolution, self.heights, self.channels = resolution, heights, channels
        self.table = nn.Parameter(torch.empty(resolution * resolution * heights, channels).uniform_(-init, init))

    def forward(
        self, uv: Float[Tensor, "S 2"], height: Float[Tensor, " S"], fade: Float[Tensor, " S"]
    ) -> Float[Tensor, "S C"]:
        """Read the features at atlas coordinates in [0, 1] and heights in [-1, 1] (the shell), times `fade`."""
        texel, weights = self._corners(uv)
        layer, layer_weights = self._layers(height)
        index = texel[:, :, None] * self.heights + layer[:, None, :]  # [S, 4, 2]
        weights = weights[:, :, None] * layer_weights[:, None, :]
        rows = nn.functional.embedding(index.flatten(1), self.table)
        return (weights.flatten(1)[..., None] * rows).sum(1) * fade[:, None]

    def _corners(self, uv: Tensor) -> tuple[Tensor, Tensor]:
        """Find the four texels around each point [S, 4], and their bilinear weights."""
        position = (uv * self.resolution - 0.5).clamp(0, self.resolution - 1)
        first = position.floor().clamp(max=self.resolution - 2)
        fraction = position - first
        u, v = first.long().unbind(-1)
        corner = v * self.resolution + u
        texel = torch.stack([corner, corner + 1, corner + self.resolution, corner + self.resolution + 1], -1)
        fu, fv = fraction.unbind(-1)
        weights = torch.stack([(1 - fu) * (1 - fv), fu * (1 - fv), (1 - fu) * fv, fu * fv], -1)
        return texel, weights

    def _layers(self, height: Tensor) -> tuple[Tensor, Tensor]:
        """Find the two layers about each height [S, 2] (a single layer: that one, [S, 1]), and their linear weights."""
        if self.heights == 1:
            return torch.zeros_like(height, dtype=torch.long)[:, None], torch.ones_like(height)[:, None]
        position = (height.clamp(-1, 1) + 1) * (self.heights - 1) / 2
        first = position.floor().clamp(max=self.heights - 2)
        share = position - first
        below = first.long()
        return torch.stack([below, below + 1], -1), torch.stack([1 - share, share], -1)


PlaneReader = Callable[[FeaturePlane, Tensor, Tensor, Tensor], Tensor]
"""(plane, uv [S, 2], height [S], fade [S]) -> features [S, C]; `FeaturePlane.forward` is the reference."""
