"""The albedo of a relightable avatar, on its mesh and over the atlas: for indirect light, mirrors and other engines."""

from __future__ import annotations

import hashlib
from copy import deepcopy
from pathlib import Path

import numpy as np
import torch
from PIL import Image
from torch.nn.functional import interpolate

from ..avatars.avatar import Avatar
from ..avatars.file import load_avatar
from ..capture.picture import linear_to_srgb
from ..field.conditions import FrameConditions
from ..field.rays import CameraTensors, HandInView, SurfaceRays, camera_tensors
from ..field.relightable import RelightableField
from ..field.shade import shade
from ..geometry.mesh import posed_mesh
from ..geometry.uvh import SurfaceSamples
from ..hand.model import HandModel
from ..hand.topology import Skinning, topology_of
from ..light.lighting import AmbientOcclusion, reflectance
from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.side import Side
from ..surface.albedo_ratio import vertex_ratio
from ..surface.atlas_texels import AtlasTexels
from ..surface.shading_detail import log_albedo
from ..system.files import replacing
from .avatar_surface import avatar_surface_of

_DISTANCE_M, _FOCAL_PX = 0.5, 1000.0
"""As if seen from here: planes finer than half a millimetre fade."""


@torch.inference_mode()
def vertex_albedo(avatar: Avatar, hand: HandModel) -> np.ndarray:
    """Compute the linear diffuse reflectance [V, 3] at the vertices of the rest pose, seen straight on.

    Raises:
        LiveHandError: the avatar is not relightable.
    """
    topology = topology_of(hand)
    albedo = _albedo_at(avatar, hand, _at_vertices(len(hand.v_template), topology.faces))
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


@torch.inference_mode()
def network_albedo(avatar: Avatar, hand: HandModel, resolution: int) -> np.ndarray:
    """Compute the albedo [A, A, 3] of the networks alone over the atlas; beyond the charts, that of the nearest texel.

    Raises:
        LiveHandError: the avatar is not relightable.
    """
    corner_uv = torch.as_tensor(hand.vt[hand.ft], dtype=torch.float32)
    texels = AtlasTexels.of(corner_uv, torch.as_tensor(hand.f), resolution)
    face, weights = torch.as_tensor(texels.face), torch.as_tensor(texels.weights)
    return texels.as_map(_albedo_at(avatar, hand, SurfaceSamples(face, weights, torch.zeros(len(face)))))


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


FIELD_RESOLUTION = 512
"""Finer than the planes of a field."""


def _albedo_at(avatar: Avatar, hand: HandModel, samples: SurfaceSamples) -> np.ndarray:
    """Compute the albedo [P, 3] of the field at points of the mesh at rest, seen straight on."""
    if not isinstance(avatar.field, RelightableField):
        raise LiveHandError(f"an albedo needs a relightable avatar, '{avatar.name}' is lit by its capture")
    field = deepcopy(avatar.field).cpu()  # the avatar may be in training on another device
    topology = topology_of(hand)
    mesh = posed_mesh(topology, torch.as_tensor(hand.v_template, dtype=torch.float32))
    corners = topology.faces[samples.face]
    normal = torch.nn.functional.normalize((mesh.normals[corners] * samples.barycentric[..., None]).sum(1), dim=-1)
    one, count = torch.full((len(corners), 1), _DISTANCE_M), len(corners)
    rays = SurfaceRays(
        torch.arange(count), -normal, one, torch.full((count,), 1e-3), torch.ones(count, dtype=torch.bool), samples
    )
    conditions = FrameConditions.of(
        torch.zeros(16, 3), Skinning.of(hand), topology, mesh, torch.zeros(len(mesh.vertices), 0)
    )
    gathered = shade(field, rays, HandInView(mesh, topology, _camera()), conditions, avatar.config.sampler.shell_m)
    sky_visibility = AmbientOcclusion(torch.ones(count), normal)
    return reflectance(field.decode(gathered, rays.directions, sky_visibility).channels).numpy()


def _at_vertices(count: int, faces: torch.Tensor) -> SurfaceSamples:
    """Sample the surface on every vertex."""
    vertex = faces.flatten()
    # The first of the vertex's corners: an assignment would take any one, and another every time.
    corner = torch.zeros(count, dtype=torch.long).scatter_reduce(
        0, vertex, torch.arange(len(vertex)), "amin", include_self=False
    )
    face = torch.div(corner, 3, rounding_mode="floor")
    return SurfaceSamples(face, torch.nn.functional.one_hot(corner % 3, 3).float(), torch.zeros(count))


def _camera() -> CameraTensors:
    K = np.array([[_FOCAL_PX, 0, 1], [0, _FOCAL_PX, 1], [0, 0, 1]])
    return camera_tensors(Camera(K, np.eye(4), (2, 2)), "cpu")
