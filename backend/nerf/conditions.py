"""What the field is told beside the position: the pose near each vertex once a frame, and the view of each sample."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Float
from torch import Tensor

from ..geometry.local_rotation import local_rotations
from ..geometry.mesh import PosedMesh, Topology
from ..geometry.uvh import SurfaceSamples, atlas_uv, interpolate
from ..geometry.visibility import visibility_transfer

LOCAL_POSE_CHANNELS = 9
EXPOSURE_CHANNELS = 8


class FieldInputs(NamedTuple):
    """S = R * N samples of R rays as the field sees them.

    Attributes:
        uv: [S, 2] in [0, 1].
        height: [S] signed height over the surface, in units of the shell: -1..1.
        normal: [S, 3] posed surface normal, world.
        rotation: [S, 3, 3] how the surface has turned there, canonical hand -> world.
        local_pose: [S, 9] skin-weighted axis-angle, rad, of the joints that move the point, their parents and children.
        exposure: [S, 8] light the point gets, self-shadowing included, in a learnt code.
        view: [R, 3] unit direction of each ray, world.
        theta: [48] the whole hand's axis-angle pose, rad.
        footprint_m: [S] width of a pixel at the sample, in the template's metres.
    """

    uv: Tensor
    height: Tensor
    normal: Tensor
    rotation: Tensor
    local_pose: Tensor
    exposure: Tensor
    view: Tensor
    theta: Tensor
    footprint_m: Tensor


def vertex_local_pose(theta: Float[Tensor, "16 3"], topology: Topology) -> Float[Tensor, "V 9"]:
    """Each vertex' own joints, their parents and their children, blended by skinning weight.

    The root's rotation is left out: it turns the hand as a whole, and normals and view already say where it faces.
    """
    fingers = theta.clone()
    fingers[0] = 0
    parents = topology.parents.clamp(min=0)
    of_parent = fingers[parents]
    of_child = torch.zeros_like(fingers).index_add(0, parents[1:], fingers[1:])
    of_child[0] = 0  # five fingers meet at the wrist: their sum says nothing
    return topology.lbs_weights @ torch.cat([fingers, of_parent, of_child], -1)


class FrameConditions(NamedTuple):
    """What is computed once per frame.

    Attributes:
        theta: [48] rad.
        vertex_channels: [V, 21] posed normal, local rotation (row-major) and local pose.
        visibility: [V, K] cosine-weighted visibility of the sky's directions.
    """

    theta: Tensor
    vertex_channels: Tensor
    visibility: Tensor

    @classmethod
    def of(cls, theta: Float[Tensor, "16 3"], topology: Topology, mesh: PosedMesh) -> FrameConditions:
        """The conditions of one posed hand; `theta` mirrored to the avatar's own side."""
        return cls.with_visibility(theta, topology, mesh, visibility_transfer(mesh, topology))

    @classmethod
    def with_visibility(
        cls, theta: Float[Tensor, "16 3"], topology: Topology, mesh: PosedMesh, visibility: Float[Tensor, "V K"]
    ) -> FrameConditions:
        """The conditions where the visibility is known: the rest has gradients to the pose and the mesh."""
        rotation = local_rotations(mesh.vertices, mesh.normals, topology.frames).flatten(1)
        channels = torch.cat([mesh.normals, rotation, vertex_local_pose(theta, topology)], -1)
        return cls(theta.reshape(-1), channels, visibility)


def field_inputs(
    samples: SurfaceSamples,
    topology: Topology,
    frame: FrameConditions,
    vertex_exposure: Float[Tensor, "V E"],
    view: Float[Tensor, "R 3"],
    footprint_m: Float[Tensor, " S"],
    shell_m: float,
) -> FieldInputs:
    """Gather what the field needs at each sample."""
    per_vertex = torch.cat([frame.vertex_channels, vertex_exposure.to(frame.vertex_channels.dtype)], -1)
    channels = interpolate(per_vertex, topology, samples)
    sizes = [3, 9, LOCAL_POSE_CHANNELS, vertex_exposure.shape[1]]
    normal, rotation, local_pose, exposure = channels.split(sizes, -1)
    return FieldInputs(
        uv=atlas_uv(topology, samples),
        height=samples.height_m / shell_m,
        normal=torch.nn.functional.normalize(normal, dim=-1),
        rotation=rotation.reshape(-1, 3, 3),
        local_pose=local_pose,
        exposure=exposure,
        view=view,
        theta=frame.theta,
        footprint_m=footprint_m,
    )


def view_features(normal: Float[Tensor, "R 3"], view: Float[Tensor, "R 3"]) -> Float[Tensor, "R 5"]:
    """Reflected ray, n.v, and Schlick's Fresnel factor.

    A raw view direction lets the field learn the training cameras by heart (2.6 dB worse from new cameras).
    """
    facing = -(normal * view).sum(-1, keepdim=True)
    reflected = view + 2 * facing * normal
    grazing = (1 - facing.clamp(0, 1)) ** 5
    return torch.cat([reflected, facing, grazing], -1)
