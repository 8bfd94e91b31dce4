"""The albedo of a relightable avatar on its mesh, for indirect light and mirrors in the scene."""

from __future__ import annotations

from copy import deepcopy

import numpy as np
import torch

from ..avatars.avatar import Avatar
from ..field.conditions import FrameConditions
from ..field.rays import CameraTensors, HandInView, SurfaceRays, camera_tensors
from ..field.relightable import RelightableField
from ..field.shade import shade
from ..geometry.mesh import PosedMesh, Topology, posed_mesh
from ..geometry.uvh import SurfaceSamples
from ..hand.model import HandModel
from ..hand.topology import Skinning, topology_of
from ..light.lighting import AmbientOcclusion, reflectance
from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..surface.albedo_ratio import vertex_ratio

_DISTANCE_M, _FOCAL_PX = 0.5, 1000.0
"""As if seen from here: planes finer than half a millimetre fade."""


@torch.inference_mode()
def vertex_albedo(avatar: Avatar, hand: HandModel) -> np.ndarray:
    """Compute the linear diffuse reflectance [V, 3] at the vertices of the rest pose, seen straight on.

    Raises:
        LiveHandError: the avatar is not relightable.
    """
    if not isinstance(avatar.field, RelightableField):
        raise LiveHandError(f"an albedo needs a relightable avatar, '{avatar.name}' is lit by its capture")
    field = deepcopy(avatar.field).cpu()  # the avatar may be in training on another device
    topology = topology_of(hand)
    mesh = posed_mesh(topology, torch.as_tensor(hand.v_template, dtype=torch.float32))
    rays, sky_visibility = (
        _rays_at_vertices(mesh, topology),
        AmbientOcclusion(torch.ones(len(mesh.vertices)), mesh.normals),
    )
    conditions = FrameConditions.of(
        torch.zeros(16, 3), Skinning.of(hand), topology, mesh, torch.zeros(len(mesh.vertices), 0)
    )
    view = HandInView(mesh, topology, _camera())
    gathered = shade(field, rays, view, conditions, avatar.config.sampler.shell_m)
    coefficients = field.decode(gathered, rays.directions, sky_visibility).channels
    albedo = reflectance(coefficients).numpy()
    ratio = None if avatar.surface is None else vertex_ratio(avatar.surface.arrays, hand.vt[hand.ft], hand.f)
    return (albedo if ratio is None else albedo * ratio).clip(0, 1)


def _rays_at_vertices(mesh: PosedMesh, topology: Topology) -> SurfaceRays:
    """Make one ray straight down on every vertex, with one opaque sample on the surface."""
    count = len(mesh.vertices)
    vertex = topology.faces.flatten()
    # The first of the vertex's corners: an assignment would take any one, and another every time.
    corner = torch.zeros(count, dtype=torch.long).scatter_reduce(
        0, vertex, torch.arange(len(vertex)), "amin", include_self=False
    )
    samples = SurfaceSamples(
        torch.div(corner, 3, rounding_mode="floor"),
        torch.nn.functional.one_hot(corner % 3, 3).float(),
        torch.zeros(count),
    )
    one = torch.full((count, 1), _DISTANCE_M)
    return SurfaceRays(
        torch.arange(count),
        -mesh.normals,
        one,
        torch.full((count,), 1e-3),
        torch.ones(count, dtype=torch.bool),
        samples,
    )


def _camera() -> CameraTensors:
    K = np.array([[_FOCAL_PX, 0, 1], [0, _FOCAL_PX, 1], [0, 0, 1]])
    return camera_tensors(Camera(K, np.eye(4), (2, 2)), "cpu")
