"""The albedo of a relightable avatar's networks, on its mesh and over the atlas, without what its surface adds."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import torch

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
from ..surface.albedo_ratio import RATIO_ARRAY
from ..surface.atlas_borders import joined_borders, split_atlas
from ..surface.atlas_texels import AtlasTexels
from ..surface.detail_surface import LEVELS
from .avatar import Avatar

_DISTANCE_M, _FOCAL_PX = 0.5, 1000.0
"""As if seen from here: planes finer than half a millimetre fade."""
FIELD_RESOLUTION = 512
"""Finer than the planes of a field."""


@torch.inference_mode()
def network_albedo(avatar: Avatar, hand: HandModel, resolution: int) -> np.ndarray:
    """Compute the albedo [A, A, 3] of the networks alone over the atlas; beyond the charts, that of the nearest texel.

    Charts meet at their borders, as pictures show them.

    Raises:
        LiveHandError: the avatar is not relightable.
    """
    corner_uv = torch.as_tensor(hand.vt[hand.ft], dtype=torch.float32)
    texels = AtlasTexels.of(corner_uv, torch.as_tensor(hand.f), resolution)
    face, weights = torch.as_tensor(texels.face), torch.as_tensor(texels.weights)
    albedo = network_albedo_at(avatar, hand, SurfaceSamples(face, weights, torch.zeros(len(face))))
    return joined_borders(texels.as_map(albedo), *split_atlas(hand.f, hand.vt[hand.ft], LEVELS))


def network_albedo_at(avatar: Avatar, hand: HandModel, samples: SurfaceSamples) -> np.ndarray:
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


def in_network_colours(avatar: Avatar) -> Avatar:
    """Return the avatar in the colours of its networks alone: without a factor on their albedo."""
    if avatar.surface is None:
        return avatar
    arrays = {name: values for name, values in avatar.surface.arrays.items() if name != RATIO_ARRAY}
    return replace(avatar, surface=replace(avatar.surface, arrays=arrays))


def _camera() -> CameraTensors:
    K = np.array([[_FOCAL_PX, 0, 1], [0, _FOCAL_PX, 1], [0, 0, 1]])
    return camera_tensors(Camera(K, np.eye(4), (2, 2)), "cpu")
