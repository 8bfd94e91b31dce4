"""The albedo of a relightable avatar, on its mesh and over the atlas: for indirect light, mirrors and other engines."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch.nn.functional import interpolate

from ..avatars.avatar import Avatar
from ..avatars.file import load_avatar
from ..avatars.network_albedo import FIELD_RESOLUTION, network_albedo, network_albedo_at
from ..capture.picture import linear_to_srgb
from ..geometry.uvh import SurfaceSamples
from ..hand.model import HandModel
from ..hand.topology import topology_of
from ..records.side import Side
from ..surface.albedo_ratio import vertex_ratio
from ..surface.shading_detail import log_albedo
from ..system.files import replacing
from .avatar_surface import avatar_surface_of


@torch.inference_mode()
def vertex_albedo(avatar: Avatar, hand: HandModel) -> np.ndarray:
    """Compute the linear diffuse reflectance [V, 3] at the vertices of the rest pose, seen straight on.

    Raises:
        LiveHandError: the avatar is not relightable.
    """
    topology = topology_of(hand)
    albedo = network_albedo_at(avatar, hand, _at_vertices(len(hand.v_template), topology.faces))
    ratio = None if avatar.surface is None else vertex_ratio(avatar.surface.arrays, hand.vt[hand.ft], hand.f)
    return (albedo if ratio is None else albedo * ratio).clip(0, 1)


@torch.inference_mode()
def atlas_albedo(avatar: Avatar, hand: HandModel, resolution: int, side: Side = "right") -> np.ndarray:
    """Compute the linear diffuse reflectance [A, A, 3] of one hand over the atlas, the row of the smallest v first.

    With the fine pigment and folds of the avatar's surface, if it has one. Beyond the charts each texel has the colour
    of the nearest within, so that mipmaps do not bleed.

    Raises:
        LiveHandError: the avatar is not relightable.
    """
    image = torch.as_tensor(network_albedo(avatar, hand, min(resolution, FIELD_RESOLUTION))).permute(2, 0, 1)
    image = interpolate(image[None], size=(resolution, resolution), mode="bilinear")[0].permute(1, 2, 0)
    surface = avatar_surface_of(avatar, torch.device("cpu"))
    if surface is not None:
        at = (torch.arange(resolution) + 0.5) / resolution
        uv = torch.stack([at.expand(resolution, -1), at[:, None].expand(-1, resolution)], -1).reshape(-1, 2)
        image = image * torch.exp(log_albedo(surface.maps_of(side), uv, resolution)).reshape(resolution, resolution, 3)
    return image.clamp(0, 1).numpy()


def baked_colors(avatar_path: Path, hand: HandModel, folder: Path, side: Side, resolution: int = 1024) -> Path:
    """Write an avatar's albedo over the atlas as an 8-bit PNG, unless it was written before; returns its path.

    Args:
        avatar_path: of the avatar.
        hand: its model.
        folder: of such files; it is made.
        side: which hand wears them.
        resolution: of the picture.

    Raises:
        LiveHandError: the avatar cannot be read, is not relightable, or the file cannot be written.
    """
    sha256 = hashlib.sha256(avatar_path.read_bytes()).hexdigest() if avatar_path.is_file() else ""
    path = folder / f"{avatar_path.stem}_{side}_{sha256[:12]}.png"
    if path.is_file():
        return path
    encoded = linear_to_srgb(atlas_albedo(load_avatar(avatar_path), hand, resolution, side))
    picture = Image.fromarray((255 * encoded[::-1]).round().astype(np.uint8))
    with replacing(path) as partial:
        picture.save(partial, format="PNG")
    return path


def _at_vertices(count: int, faces: torch.Tensor) -> SurfaceSamples:
    """Sample the surface on every vertex."""
    vertex = faces.flatten()
    # The first of the vertex's corners: an assignment would take any one, and another every time.
    corner = torch.zeros(count, dtype=torch.long).scatter_reduce(
        0, vertex, torch.arange(len(vertex)), "amin", include_self=False
    )
    face = torch.div(corner, 3, rounding_mode="floor")
    return SurfaceSamples(face, torch.nn.functional.one_hot(corner % 3, 3).float(), torch.zeros(count))
