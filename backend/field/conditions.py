"""What the field is conditioned on: per vertex once a frame (pose, rotation, visibility), per ray the view."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import torch
from jaxtyping import Float, Int
from torch import Tensor

from ..geometry.local_rotation import LocalFrames, local_rotations
from ..geometry.mesh import PosedMesh, Topology
from ..geometry.uvh import SurfaceSamples, atlas_uv, interpolate
from ..hand.topology import Skinning

LOCAL_POSE_CHANNELS = 9
LIGHT_CHANNELS = 8


Rotations = Callable[[Tensor, Tensor, LocalFrames], Tensor]
"""`local_rotations`, or what equals it."""


class FieldInputs(NamedTuple):
    """Inputs of the field at S = R * N samples of R rays.

    Attributes:
        uv: [S, 2] in [0, 1].
        height: [S] signed height over the surface, in units of the shell: -1..1.
        normal: [S, 3] posed surface normal, world.
        rotation: [S, 3, 3] local rotation of the surface, canonical hand -> world.
        local_pose: [S, 9] skin-weighted axis-angle, rad, of the joints that move the point, their parents and children.
        light: [S, 8] learned code of the light that reaches the point, with self-shadowing.
        view: [R, 3] unit direction of each ray, world.
        theta: [48] the whole hand's axis-angle pose, rad.
        footprint_m: [S] width of a pixel at the sample, in the template's metres.
        place: where the sample lies in space, for fields that ask for it.
        identity: which of the field's identities is shown; fields of one person have none.
    """

    uv: Tensor
    height: Tensor
    normal: Tensor
    rotation: Tensor
    local_pose: Tensor
    light: Tensor
    view: Tensor
    theta: Tensor
    footprint_m: Tensor
    place: SamplePoints | None = None
    identity: int = 0

    @classmethod
    def of_paper(cls, uv: Tensor, height: Tensor, view: Tensor, theta: Tensor) -> FieldInputs:
        """Make the inputs that the paper's field reads; the others are empty."""
        none = height.new_zeros(0)
        return cls(uv, height, none, none, none, none, view, theta, none)


class SamplePoints(NamedTuple):
    """S samples in space.

    Attributes:
        world: [S, 3] m.
        in_bones: [S, 16, 3] in each bone's frame, in the template's metres; [S, 0, 3] where no field asks for it.
        bone_weights: [S, 16] skinning weights of the surface point below; or [S, 0].
    """

    world: Tensor
    in_bones: Tensor
    bone_weights: Tensor


def vertex_local_pose(theta: Float[Tensor, "16 3"], skinning: Skinning) -> Float[Tensor, "V 9"]:
    """Blend the axis-angle of each vertex's joints, of their parents and children, by skinning weight, rad.

    The root's rotation is left out: it turns the whole hand, which normals and view directions already express.
    """
    return skinning.lbs_weights @ joint_pose(theta, skinning.parents)


def joint_pose(theta: Float[Tensor, "16 3"], parents: Int[Tensor, " 16"]) -> Float[Tensor, "16 9"]:
    """Join each joint's axis-angle, its parent's and its child's, rad."""
    fingers = theta.clone()
    fingers[0] = 0
    parents = parents.clamp(min=0)
    of_parent = fingers[parents]
    of_child = torch.zeros_like(fingers).index_add(0, parents[1:], fingers[1:])
    of_child[0] = 0  # the sum over five fingers carries no information
    return torch.cat([fingers, of_parent, of_child], -1)


class FrameConditions(NamedTuple):
    """Conditions of one posed hand, computed once per frame.

    Attributes:
        theta: [48] rad.
        vertex_channels: [V, 21] posed normal, local rotation (row-major) and local pose.
        visibility: [V, K] cosine-weighted visibility of the sky's directions.
        bones: [16, 4, 4] bone frames to the world, for fields that look at bones; None: not known.
        bone_weights: [V, 16] skinning weights; None with `bones`.
        identity: which of the field's identities is shown; fields of one person have none.
    """

    theta: Tensor
    vertex_channels: Tensor
    visibility: Tensor
    bones: Tensor | None = None
    bone_weights: Tensor | None = None
    identity: int = 0

    @classmethod
    def of(
        cls,
        theta: Float[Tensor, "16 3"],
        skinning: Skinning,
        topology: Topology,
        mesh: PosedMesh,
        visibility: Float[Tensor, "V K"],
        rotations_of: Rotations = local_rotations,
    ) -> FrameConditions:
        """Compute the conditions, with gradients to the pose and the mesh.

        Args:
            theta: rad, mirrored to the avatar's own side.
            skinning: of the hand.
            topology: of the mesh.
            mesh: the pose.
            visibility: as `ReferenceBackend.visibility` gives it.
            rotations_of: as `local_rotations`, whose gradients are the mesh's.
        """
        rotation = rotations_of(mesh.vertices, mesh.normals, topology.frames).flatten(1)
        channels = torch.cat([mesh.normals, rotation, vertex_local_pose(theta, skinning)], -1)
        return cls(theta.reshape(-1), channels, visibility)


def gather_field_inputs(
    samples: SurfaceSamples,
    topology: Topology,
    frame: FrameConditions,
    vertex_light: Float[Tensor, "V E"],
    view: Float[Tensor, "R 3"],
    footprint_m: Float[Tensor, " S"],
    shell_m: float,
) -> FieldInputs:
    """Interpolate the per-vertex conditions at each sample."""
    per_vertex = torch.cat([frame.vertex_channels, vertex_light.to(frame.vertex_channels.dtype)], -1)
    channels = interpolate(per_vertex, topology, samples)
    sizes = [3, 9, LOCAL_POSE_CHANNELS, vertex_light.shape[1]]
    normal, rotation, local_pose, light = channels.split(sizes, -1)
    return FieldInputs(
        uv=atlas_uv(topology, samples),
        height=samples.height_m / shell_m,
        normal=torch.nn.functional.normalize(normal, dim=-1),
        rotation=rotation.reshape(-1, 3, 3),
        local_pose=local_pose,
        light=light,
        view=view,
        theta=frame.theta,
        footprint_m=footprint_m,
        identity=frame.identity,
    )


def view_features(normal: Float[Tensor, "R 3"], view: Float[Tensor, "R 3"]) -> Float[Tensor, "R 5"]:
    """Compute the reflected ray, n.v, and Schlick's Fresnel factor.

    A raw view direction overfits to the training cameras (2.6 dB worse from new cameras).
    """
    facing = -(normal * view).sum(-1, keepdim=True)
    reflected = view + 2 * facing * normal
    grazing = (1 - facing.clamp(0, 1)) ** 5
    return torch.cat([reflected, facing, grazing], -1)
