"""Whose skin an avatar shows: that of people whom `livehand capture` made is known, its fine surface and its detail."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import torch

from ..avatars.avatar import Avatar
from ..compute.reference import ReferenceBackend
from ..geometry.local_rotation import LocalFrames
from ..geometry.mesh import PosedMesh
from ..hand.model import MIRROR_AXIS_ANGLE, HandModel
from ..records.shot import HandPose
from ..surface.detail_maps import DetailMaps, SkinLook
from ..surface.detail_maps_file import SkinBend, load_skin_detail
from ..surface.fine_mesh import FineMesh, FineTemplate, motion_of_mesh
from ..surface.fine_surface import FineSurface, load_fine_surface
from ..surface.hair_growth import Hairs, HairySkin, grown_hairs
from ..surface.hairs import hair_albedo

_ON_POSE_M = 1e-4  # a mesh that is nowhere farther from that of its pose is moved by it alone


@dataclass(frozen=True)
class KnownSkin:
    """A person's skin.

    Attributes:
        maps: its detail.
        bend: how poses bend it.
        surface: on which it lies.
        veins_mm: height of veins.
        hair_albedo: of hairs, RGB.
    """

    maps: DetailMaps
    bend: SkinBend
    surface: FineSurface
    veins_mm: float
    hair_albedo: tuple[float, ...]

    def posed(
        self,
        template: FineTemplate,
        pose: HandPose,
        mesh: PosedMesh,
        frames: LocalFrames,
        backend: ReferenceBackend,
    ) -> FineMesh:
        """The surface over a posed mesh.

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
            motion = motion_of_mesh(template, mesh, frames)
        mirror = 1 if pose.side == "right" else MIRROR_AXIS_ANGLE
        theta, forearm = pose.theta * mirror, pose.forearm * mirror
        height_m = 1e-3 * self.surface.raised.height_mm(theta, self.veins_mm, forearm)
        height = torch.as_tensor(height_m[: len(template.offset_m)], dtype=torch.float32, device=device)
        flex = torch.as_tensor(self.bend.flex(theta), dtype=torch.float32, device=device)
        return backend.fine_mesh(template, motion, height, flex, mesh.scale)


def hairs_on(template: FineTemplate, hand: HandModel) -> Hairs:
    """The hairs, which serve both sides; template and hand are the right one's."""
    tensors = template.rest_vertices(), template.normals, template.faces, template.bones.of_face
    vertices, normals, faces, bone = (values.cpu().numpy() for values in tensors)
    return grown_hairs(HairySkin(vertices, normals, faces, bone, hand.joints))


def skin_of(avatar: Avatar, device: torch.device) -> KnownSkin | None:
    """The skin that the avatar was trained on; None: its capture showed another than the built-in one."""
    return skin_of_capture(avatar.provenance.get("capture"), avatar.hand_sha256, device)


def skin_of_capture(provenance: Any, hand_sha256: str, device: torch.device) -> KnownSkin | None:
    """The same, by a capture's provenance and hand."""
    person = _person(provenance)
    if person is None:
        return None
    detail, surface = load_skin_detail(hand_sha256), load_fine_surface(hand_sha256)
    if detail is None or surface is None:
        return None
    maps = DetailMaps.of(detail, person, device)
    return KnownSkin(maps, detail.bend, surface, person.veins_mm, hair_albedo(person.melanin))


def _person(capture: Any) -> SkinLook | None:
    """The person in a capture of the built-in skin, by its provenance."""
    if not isinstance(capture, dict) or capture.get("made_by") != "livehand capture" or "look_sha256" in capture:
        return None
    plan = capture.get("plan")
    person = plan.get("person") if isinstance(plan, dict) else None
    if not isinstance(person, dict) or person.get("nail_polish") is not None:
        return None
    numbers = [person.get(name) for name in SkinLook._fields]
    known = [float(value) for value in numbers if isinstance(value, int | float) and math.isfinite(value)]
    return SkinLook(*known) if len(known) == len(numbers) else None
