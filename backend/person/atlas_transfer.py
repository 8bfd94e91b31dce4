"""Maps over the atlas of another hand model as maps over the built-in hand's, and back.

Both hands lie upon each other at rest (`rigs.model_transfer`): what is nearest on the same finger is the same skin. The
built-in hand's arm beyond the other's wrist has none.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import map_coordinates

from ..hand.model import HandModel
from ..rigs.model_transfer.model_transfer import ModelTransfer
from ..rigs.model_transfer.region_mesh import RegionMesh
from ..surface.atlas_texels import AtlasTexels

_FARTHEST_M = 0.003
_LEAST_AGREEMENT = 0.3  # cosine of both surfaces' normals
_LEAST_SHARE = 0.5  # of a texel's corners that have a point


@dataclass(frozen=True)
class AtlasTransfer:
    """From the atlas of one hand to that of another.

    Attributes:
        start: whose atlas maps are taken from.
        texels: of the other's atlas.
        uv: [T, 2] in the atlas of `start`, of each texel.
        is_covered: [T] whether `start` has skin there.
    """

    start: HandModel
    texels: AtlasTexels
    uv: np.ndarray
    is_covered: np.ndarray

    @classmethod
    def to_ours(cls, transfer: ModelTransfer, resolution: int) -> AtlasTransfer:
        """Prepare maps [A, A] of the built-in hand's atlas from those of the other model's."""
        found = transfer.registration
        ours, other = (RegionMesh.of(*pair) for pair in _laid(transfer))
        return _between(transfer.other, other, transfer.ours, ours, found.weight, resolution)

    @classmethod
    def to_other(cls, transfer: ModelTransfer, resolution: int) -> AtlasTransfer:
        """Prepare maps [A, A] of the other model's atlas from those of the built-in hand's."""
        ours, other = (RegionMesh.of(*pair) for pair in _laid(transfer))
        return _between(transfer.ours, ours, transfer.other, other, np.ones(len(other.vertices)), resolution)

    def carried(self, image: np.ndarray) -> np.ndarray:
        """Carry a map [H, W, C] over, its rows by v, the smallest first.

        Returns:
            [A, A, C] float32; what is not covered, and what lies beyond the charts, has the nearest texel's value.
        """
        sampled = self._sampled(image)
        covered = self._covered
        return covered.as_map(sampled[self.is_covered])

    @property
    def coverage(self) -> np.ndarray:
        """[A, A] bool: texels of skin that both hands have."""
        size = self.texels.resolution
        image = np.zeros(size * size, bool)
        image[self.texels.pixel[self.is_covered]] = True
        return image.reshape(size, size)

    @property
    def _covered(self) -> AtlasTexels:
        texels, kept = self.texels, self.is_covered
        return AtlasTexels(texels.resolution, texels.pixel[kept], texels.face[kept], texels.weights[kept], texels.faces)

    def _sampled(self, image: np.ndarray) -> np.ndarray:
        """Sample a map at the texels' coordinates [T, C], bilinear; charts are grown beyond their borders first."""
        height, width = image.shape[:2]
        if height == width:
            grown = _texels(self.start, height)
            image = grown.as_map(grown.from_map(np.ascontiguousarray(image, np.float32)))
        at = self.uv[:, ::-1].T * [[height], [width]] - 0.5
        channels = [map_coordinates(image[..., k], at, order=1, mode="nearest") for k in range(image.shape[2])]
        return np.stack(channels, 1).astype(np.float32)


def _laid(transfer: ModelTransfer) -> tuple[tuple[HandModel, np.ndarray], tuple[HandModel, np.ndarray]]:
    """Return both models with their vertices where they lie upon each other."""
    return (transfer.ours, transfer.registration.conformed), (transfer.other, transfer.other.v_template)


def _between(
    start: HandModel, start_mesh: RegionMesh, end: HandModel, end_mesh: RegionMesh, weight: np.ndarray, resolution: int
) -> AtlasTransfer:
    """Find the coordinates in the atlas of `start` of every texel of `end`, whose vertices have weights [V]."""
    texels = _texels(end, resolution)
    points = texels.at_texels(end_mesh.vertices)
    found = start_mesh.nearest(points, end_mesh.face_regions[texels.face])
    own, other = texels.at_texels(end_mesh.normals), found.blended(start_mesh.normals[start_mesh.faces])
    agreement = (own * other).sum(1) / (np.linalg.norm(own, axis=1) * np.linalg.norm(other, axis=1)).clip(1e-9)
    is_covered = (found.distance_m < _FARTHEST_M) & (agreement > _LEAST_AGREEMENT)
    is_covered &= texels.at_texels(weight[:, None])[:, 0] > _LEAST_SHARE
    return AtlasTransfer(start, texels, found.blended(start.vt[start.ft]), is_covered)


def _texels(model: HandModel, resolution: int) -> AtlasTexels:
    corner_uv = torch.as_tensor(model.vt[model.ft], dtype=torch.float32)
    return AtlasTexels.of(corner_uv, torch.as_tensor(model.f), resolution)
