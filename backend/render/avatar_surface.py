"""The surface of an avatar, ready to pose: its shape, its detail and its hairs."""

from __future__ import annotations

from dataclasses import dataclass

import torch

from ..avatars.avatar import Avatar
from ..avatars.captured_surface import surface_of_capture
from ..capture.capture import Capture
from ..compute.reference import ReferenceBackend
from ..geometry.local_rotation import LocalFrames
from ..geometry.mesh import PosedMesh
from ..hand.model import MIRROR_AXIS_ANGLE
from ..records.shot import HandPose
from ..records.side import Side
from ..surface.albedo_ratio import MARKS_ARRAYS, AlbedoRatio
from ..surface.base_surface import whole_surface
from ..surface.blood import JointBlood
from ..surface.detail_maps import DetailMaps, SkinLook
from ..surface.detail_maps_file import SkinFlexion, skin_detail_of
from ..surface.detail_mesh import DetailMesh, DetailTemplate, skin_motion_of
from ..surface.detail_surface import DetailSurface, detail_surface_of
from ..surface.hair_growth import HairGround, HairGrowth, Hairs, grown_hairs
from ..surface.hairs import hair_albedo
from ..surface.stored_surface import StoredSurface

_ON_POSE_M = 1e-4  # a mesh that is nowhere farther from that of its pose is moved by it alone


@dataclass(frozen=True)
class AvatarSurface:
    """A person's skin.

    Attributes:
        maps: its detail, of the right hand.
        left_ratio: of the left hand's albedo, in place of that of `maps`.
        bend: how poses bend it.
        surface: on which it lies.
        veins_mm: height of veins.
        hair_albedo: of hairs, RGB.
        hair_growth: where hairs grow, and how.
        joint_blood: that bending draws out of the joints; None: the networks know all that poses do to their colour.
    """

    maps: DetailMaps
    left_ratio: AlbedoRatio | None
    bend: SkinFlexion
    surface: DetailSurface
    veins_mm: float
    hair_albedo: tuple[float, ...]
    hair_growth: HairGrowth
    joint_blood: JointBlood | None = None

    def maps_of(self, side: Side) -> DetailMaps:
        """Return the detail of one hand."""
        return self.maps if side == "right" else self.maps._replace(ratio=self.left_ratio)

    def posed(
        self,
        template: DetailTemplate,
        pose: HandPose,
        mesh: PosedMesh,
        frames: LocalFrames,
        backend: ReferenceBackend,
    ) -> DetailMesh:
        """Compute the surface over a posed mesh.

        Args:
            template: of the pose's side.
            pose: of the mesh.
            mesh: that of the pose; or sculpted, scaled or of a retargeted rig.
            frames: of the mesh's topology.
            backend: poses it.
        """
        device = mesh.vertices.device
        motion = backend.skin_motion(template.skin, pose)
        if (motion.vertices - mesh.vertices).abs().max() > _ON_POSE_M:
            motion = skin_motion_of(template, mesh, frames)
        mirror = 1 if pose.side == "right" else MIRROR_AXIS_ANGLE
        theta, forearm = pose.theta * mirror, pose.forearm * mirror
        height_m = 1e-3 * self.surface.raised.height_mm(theta, self.veins_mm, forearm)
        height = torch.as_tensor(height_m[: len(template.offset_m)], dtype=torch.float32, device=device)
        flex = torch.as_tensor(self.bend.flex(theta), dtype=torch.float32, device=device)
        return backend.detail_mesh(template, motion, height, flex, mesh.scale)


def hairs_on(skin: AvatarSurface, template: DetailTemplate) -> Hairs:
    """Grow the hairs, which serve both sides; the template is the right one's."""
    tensors = template.rest_vertices(), template.normals, template.faces
    return grown_hairs(HairGround(*(values.cpu().numpy() for values in tensors)), skin.hair_growth)


def avatar_surface_of(avatar: Avatar, device: torch.device) -> AvatarSurface | None:
    """Return the avatar's surface; None: it has none.

    Raises:
        LiveHandError: its base is another version's.
    """
    return None if avatar.surface is None else _posable(avatar.surface, device)


def skin_of_capture(capture: Capture, device: torch.device) -> AvatarSurface | None:
    """Load the surface that a capture shows; None: it names none.

    Raises:
        LiveHandError: its file is missing or broken.
    """
    surface = surface_of_capture(capture)
    return None if surface is None else _posable(surface, device)


def _posable(surface: StoredSurface, device: torch.device) -> AvatarSurface:
    arrays, person = whole_surface(surface).arrays, surface.person
    detail = skin_detail_of(arrays)
    maps = DetailMaps.of(detail, SkinLook(person.melanin, person.folds, person.veins_mm), device)
    right = AlbedoRatio.of_side(arrays, "right", device)
    # Without marks both hands share one.
    has_marks = any(name in arrays for name in MARKS_ARRAYS.values())
    return AvatarSurface(
        maps=maps._replace(ratio=right),
        left_ratio=AlbedoRatio.of_side(arrays, "left", device) if has_marks else right,
        bend=detail.bend,
        surface=detail_surface_of(arrays).with_tendons(person.tendons),
        veins_mm=person.veins_mm,
        hair_albedo=hair_albedo(person.melanin),
        hair_growth=HairGrowth(arrays["hair/share"], surface.hair),
        joint_blood=JointBlood.of(arrays, person.melanin, device),
    )
