"""What a backend that renders whole frames is given: what they are made of, and one shot; all of it on the host."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from torch import Tensor

from ..field.field import BakedField, PlaneField
from ..field.rays import CameraTensors
from ..field.relightable import RelightableField
from ..field.sampler import SamplerConfig
from ..geometry.mesh import Topology
from ..hand.topology import Skinning
from ..image.superres import ResidualSuperRes
from ..light.lamp_samples import LampSamples
from ..light.nearby_geometry import Patches
from ..light.samples import LightSamples
from ..light.shadow_maps import Bounds
from ..records.shot import HandPose
from ..surface.blood import JointBlood
from ..surface.detail_maps import DetailMaps
from ..surface.detail_mesh import DetailTemplate
from ..surface.detail_surface import RaisedParts
from ..surface.hair_growth import Hairs


@dataclass(frozen=True)
class FrameModel:
    """What frames of every avatar are made of, as CPU's tensors.

    Attributes:
        field: whose decoder and planes are asked.
        superres: of its rays.
        topology: of the hand's mesh.
        skinning: of the hand.
        sampler: of the rays.
    """

    field: PlaneField
    superres: ResidualSuperRes
    topology: Topology
    skinning: Skinning
    sampler: SamplerConfig

    @property
    def vertices(self) -> int:
        """Of the hand's mesh."""
        return len(self.skinning.lbs_weights)


@dataclass(frozen=True)
class BakedModel(FrameModel):
    """What frames in the light of a capture are made of."""

    field: BakedField


@dataclass(frozen=True)
class LitModel(FrameModel):
    """What lit frames are made of; rays are sampled at the avatar's surface.

    Attributes:
        template: of the avatar's surface.
        raised: what rises on it.
        maps: of its detail.
        joint_blood: that bending draws out of its joints; None: none.
        albedo: [V, 3] of the skin at the mesh's vertices.
        stands_out_m: how far skin may stand out of the mesh, template metres.
        edge_m: by how much the depths of two surfaces differ, template metres.
        grow_hairs: returns all hairs of the hand.
        hair_albedo: of these, RGB.
    """

    field: RelightableField
    template: DetailTemplate
    raised: RaisedParts
    maps: DetailMaps
    joint_blood: JointBlood | None
    albedo: Tensor
    stands_out_m: float
    edge_m: float
    grow_hairs: Callable[[], Hairs]
    hair_albedo: tuple[float, ...]

    @property
    def casting_faces(self) -> int:
        """Of the surface, that cast the shadows of lamps."""
        return len(self.template.coarse_faces)

    @cached_property
    def hairs(self) -> Hairs:
        """All hairs of the hand."""
        return self.grow_hairs()

    @cached_property
    def casting_vertices(self) -> int:
        """Of these faces, the first of the surface's."""
        return int(self.template.coarse_faces.max()) + 1


class LitShot(NamedTuple):
    """A hand in a light, of which everything lies on the host.

    Attributes:
        pose: of the hand.
        vertices: [V, 3] m, world.
        joint_pose: [16, 9] what `vertex_local_pose` blends, rad.
        raised_shares: [1 + forms] how much of what the model says rises on the avatar's surface.
        flex: [V] bend of the skin.
        camera: of the rays; the image is twice as large.
        window_px: the columns and rows of their image that have rays, the first ones.
        scale: of the hand against its template.
        bounds: of its vertices.
        light: sampled around these.
        is_hard: which of its samples are of lamps whose shadows have edges.
        at_surfels: its lamps as they light the skin that reflects light, in fewer samples where shadows are fine.
        has_fine_shadows: whether all of the surface's faces cast those of hard lamps.
        occluders: [T, 3, 3] m, world, corners of triangles that cast shadows on the hand.
        patches: of these that reflect light; None: nothing does.
        hairs: how many of the hand's it shows.
        pressed: [N, 2] shares of blood that has left the surface's skin, and the beds of nails; None: nowhere.
    """

    pose: HandPose
    vertices: np.ndarray
    joint_pose: np.ndarray
    raised_shares: np.ndarray
    flex: np.ndarray
    camera: CameraTensors
    window_px: tuple[int, int]
    scale: float
    bounds: Bounds
    light: LightSamples
    is_hard: np.ndarray
    at_surfels: LampSamples
    has_fine_shadows: bool
    occluders: np.ndarray
    patches: Patches | None
    hairs: int
    pressed: np.ndarray | None


class BakedShot(NamedTuple):
    """A hand in the light of its avatar's capture, of which everything lies on the host.

    Attributes:
        vertices: [V, 3] m, world.
        joint_pose: [16, 9] what `vertex_local_pose` blends, rad.
        camera: of the rays; the image is twice as large.
        window_px: the columns and rows of their image that have rays, the first ones.
        scale: of the hand against its template.
        bounds: of its vertices.
    """

    vertices: np.ndarray
    joint_pose: np.ndarray
    camera: CameraTensors
    window_px: tuple[int, int]
    scale: float
    bounds: Bounds


class ShotPixels(NamedTuple):
    """A frame of H x W pixels: premultiplied scene-linear RGB [H, W, 3], alpha [H, W], and depth [H, W], m."""

    rgb: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray


class RayOpacity(NamedTuple):
    """Where R rays of N samples are opaque, as `records.depth_profile.DepthProfile` at the rays' own size.

    Attributes:
        row: [h, w] of the ray through each pixel of their image, -1 for none.
        t: [R, N] depth of samples, m.
        dt: [R] their step, m.
        weights: [R, N] what each contributes to alpha.
    """

    row: np.ndarray
    t: np.ndarray
    dt: np.ndarray
    weights: np.ndarray


@runtime_checkable
class LitFrameRenderer(Protocol):
    """Renders lit frames of one model."""

    def render(self, shot: LitShot) -> ShotPixels | None:
        """Render a frame, whose pixels are valid until the next.

        Returns:
            None if the shot has more of something than there is room for.
        """
        ...


@runtime_checkable
class BakedFrameRenderer(Protocol):
    """Renders frames in a capture's light of one model."""

    def render(self, shot: BakedShot) -> tuple[ShotPixels, RayOpacity] | None:
        """Render a frame, as `LitFrameRenderer.render`, and how opaque its rays are."""
        ...
