"""An avatar's skin as textures over the atlas, of a straight hand: albedo, normal and roughness, for other engines.

Light that is scattered far in the skin shows less relief; the normal is that of gloss, which shows all of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor
from torch.nn.functional import normalize

from ...avatars.avatar import Avatar
from ...geometry.mesh import vertex_normals
from ...hand.model import HandModel
from ...light.brdf import NAIL_ROUGHNESS, ROUGHNESS
from ...surface.atlas_texels import AtlasTexels
from ...surface.detail_maps import DetailMaps
from ...surface.shading_detail import TexelDetail, atlas_gradients, texel_detail
from ..albedo import atlas_albedo
from ..avatar_surface import avatar_surface_of

_AT_ONCE = 1 << 18  # texels


class AtlasTextures(NamedTuple):
    """Textures of A x A texels, the row of the smallest v first.

    Attributes:
        albedo: [A, A, 3] linear.
        normal: [A, A, 3] unit, in the tangent space of MikkTSpace: along u, along v, outward.
        roughness: [A, A] the square root of the microfacets' alpha.
    """

    albedo: np.ndarray
    normal: np.ndarray
    roughness: np.ndarray


@torch.inference_mode()
def atlas_textures(avatar: Avatar, hand: HandModel, resolution: int) -> AtlasTextures:
    """Bake the textures of an avatar on a hand of either side.

    Raises:
        LiveHandError: the avatar is not relightable.
    """
    albedo = atlas_albedo(avatar, hand.for_side("right"), resolution, hand.side)
    surface = avatar_surface_of(avatar, torch.device("cpu"))
    flat = np.zeros((resolution, resolution, 3), np.float32)
    flat[..., 2] = 1
    if surface is None:
        return AtlasTextures(albedo, flat, np.full((resolution, resolution), ROUGHNESS[1], np.float32))
    corner_uv, faces = torch.as_tensor(hand.vt[hand.ft], dtype=torch.float32), torch.as_tensor(hand.f)
    texels = AtlasTexels.of(corner_uv, faces, resolution)
    frames = _TexelFrames(torch.as_tensor(hand.v_template, dtype=torch.float32), corner_uv, faces)
    parts = [_baked(skin, frames, texels, rows) for skin, rows in _skin_of_texels(surface.maps_of(hand.side), texels)]
    normal, roughness = (np.concatenate(values) for values in zip(*parts, strict=True))
    return AtlasTextures(albedo, texels.as_map(normal), texels.as_map(roughness[:, None])[..., 0])


def _skin_of_texels(maps: DetailMaps, texels: AtlasTexels) -> Iterator[tuple[TexelDetail, slice]]:
    resolution = texels.resolution
    for start in range(0, len(texels.pixel), _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        pixel = torch.as_tensor(texels.pixel[rows])
        uv = torch.stack([pixel % resolution, torch.div(pixel, resolution, rounding_mode="floor")], 1) + 0.5
        yield texel_detail(maps, uv / resolution, resolution), rows


class _TexelFrames:
    """The tangent spaces of a hand at rest."""

    def __init__(self, vertices: Tensor, corner_uv: Tensor, faces: Tensor):
        self._normals, self._faces = vertex_normals(vertices, faces), faces
        self._gradients = atlas_gradients(vertices[faces], corner_uv)

    def tangent_normals(self, texels: AtlasTexels, rows: slice, slopes: Tensor) -> Tensor:
        """Compute [P, 3] in tangent space where the surface has slopes [P, 2] along u and v."""
        face, weights = torch.as_tensor(texels.face[rows]), torch.as_tensor(texels.weights[rows])
        normal = normalize((self._normals[self._faces[face]] * weights[..., None]).sum(1), dim=-1)
        along_u, along_v = self._gradients[face].unbind(1)
        bent = normal - slopes[:, :1] * along_u - slopes[:, 1:] * along_v
        sign = (torch.linalg.cross(along_u, along_v) * normal).sum(-1, keepdim=True).sign()
        tangent = sign * torch.linalg.cross(along_v, normal)
        tangent = normalize(tangent - (tangent * normal).sum(-1, keepdim=True) * normal, dim=-1)
        bitangent = sign * torch.linalg.cross(normal, tangent)
        return normalize(torch.stack([(bent * axis).sum(-1) for axis in (tangent, bitangent, normal)], -1), dim=-1)


def _baked(skin: TexelDetail, frames: _TexelFrames, texels: AtlasTexels, rows: slice) -> tuple[np.ndarray, np.ndarray]:
    normal = frames.tangent_normals(texels, rows, skin.slopes)
    of_skin = skin.alpha_squared**0.25
    roughness = of_skin + (NAIL_ROUGHNESS - of_skin) * skin.nail.clamp(0, 1)
    return normal.numpy(), roughness.clamp(0, 1).numpy()
