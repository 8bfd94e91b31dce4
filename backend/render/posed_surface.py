"""The avatar's surface over a posed hand, in frames and in training: its mesh, where rays meet it, its hair."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import torch
from jaxtyping import Int
from torch import Tensor

from ..compute.reference import ReferenceBackend
from ..field.rays import CameraTensors, HandInView, view_directions
from ..geometry.local_rotation import LocalFrames
from ..geometry.mesh import PosedMesh
from ..hand.model import HandModel
from ..image.shading import ShadingInputs, covered_pixels, doubled
from ..records.shot import HandPose, Shot
from ..records.side import Side
from ..surface.blood import Blanching
from ..surface.curved_faces import CurvedFaces, roundness_in
from ..surface.detail_maps import DetailMaps
from ..surface.detail_mesh import DetailMesh, DetailTemplate, LevelsOfDetail, on_surface
from ..surface.hair_growth import Hairs
from ..surface.hairs import PosedHairs
from ..surface.ray_hits import RayHits
from ..surface.shading_detail import DetailPixels, detail_pixels, with_detail
from .avatar_surface import AvatarSurface, hairs_on


class SurfaceInView(NamedTuple):
    """The avatar's surface in a pose and a view.

    Attributes:
        maps: of its detail.
        mesh: posed; it casts shadows.
        hits: where the rays of all low-resolution pixels meet what is shown.
        shown: the mesh as images show it.
        hairs: on it; None: it shows none.
        pale: where what is shown lacks blood; None: nowhere.
    """

    maps: DetailMaps
    mesh: DetailMesh
    hits: RayHits
    shown: DetailMesh
    hairs: PosedHairs | None = None
    pale: Blanching | None = None

    def met(self, hand: HandInView) -> HandInView:
        """Return the hand as rays of its field meet it, which end on the surface."""
        return on_surface(hand, self.mesh, self.hits.depth)


class SurfacePixels(NamedTuple):
    """What the R rays of a view and its full-size image show of the surface: all that training keeps of it.

    Attributes:
        pixels: of the full-size image.
        hits: of the rays.
    """

    pixels: DetailPixels
    hits: RayHits

    def detailed(self, image: ShadingInputs) -> ShadingInputs:
        """Return the image with the surface's outline and detail, with gradients to its colours."""
        return with_detail(image, self.pixels)

    def halved(self) -> SurfacePixels:
        """Return the same in half precision, but for whole numbers and the rays' depths."""
        pixels = (values.half() if values.is_floating_point() else values for values in self.pixels)
        return SurfacePixels(DetailPixels(*pixels), self.hits._replace(normal=self.hits.normal.half()))

    def whole(self) -> SurfacePixels:
        """Return the same in single precision."""
        pixels = (values.float() if values.is_floating_point() else values for values in self.pixels)
        return SurfacePixels(DetailPixels(*pixels), self.hits._replace(normal=self.hits.normal.float()))


@dataclass(frozen=True)
class SurfacePoser:
    """Poses the avatar's surface over the meshes of its hand.

    Attributes:
        skin: the surface and its detail.
        hand: the model of the meshes, of either side.
        device: of the tensors.
        backend: poses and rasterises.
    """

    skin: AvatarSurface
    hand: HandModel
    device: torch.device
    backend: ReferenceBackend

    def with_maps(self, maps: DetailMaps) -> SurfacePoser:
        """Return the same surface with other maps of its detail, on both hands; templates are shared."""
        other = replace(self, skin=replace(self.skin, maps=maps, left_ratio=maps.ratio))
        other._levels.update(self._levels)
        other._curved_faces.update(self._curved_faces)
        return other

    def posed(self, shot: Shot, hand: HandInView) -> SurfaceInView:
        """Return the surface of a shot: of what moves, in fewer faces if the view allows it, and without hairs.

        What is kept is shown with curved faces if the view shows that they are flat.
        """
        levels, is_kept = self.levels(shot.pose.side), shot.quality == "final"
        template = levels.finest if is_kept else levels.visible_in(hand)
        roundness = roundness_in(hand) if is_kept else 0.0
        surface = self.in_view(shot.pose, hand, template, roundness)
        pale = self._blanching(shot, surface.mesh, template)
        if pale is not None and roundness > 0:
            pale = pale.on_curved(self.curved_faces(shot.pose.side))
        surface = surface._replace(pale=pale)
        if shot.hair == 0 or not is_kept:
            return surface
        return surface._replace(hairs=PosedHairs.of(self.hairs.first(shot.hair), surface.mesh, self.skin.hair_albedo))

    def _blanching(self, shot: Shot, mesh: DetailMesh, template: DetailTemplate) -> Blanching | None:
        joints = None if self.skin.joint_blood is None else self.skin.joint_blood.blanching(mesh.flex)
        if shot.pressed_m is None:
            return joints
        return Blanching.of(shot.pressed_m, template).and_of(joints)

    def in_view(
        self, pose: HandPose, hand: HandInView, template: DetailTemplate | None = None, roundness: float = 0.0
    ) -> SurfaceInView:
        """Return the surface over a hand in this pose.

        Args:
            pose: of the hand.
            hand: in view.
            template: as in `mesh`.
            roundness: of its faces' edges; above 0 the template must be the finest.
        """
        mesh = self.mesh(pose, hand.mesh, hand.topology.frames, template)
        shown = self.curved_faces(pose.side).curved(mesh, roundness) if roundness > 0 else mesh
        hits = self.backend.ray_hits(shown, hand.camera, hand.camera.every_pixel)
        return SurfaceInView(self.skin.maps_of(pose.side), mesh, hits, shown)

    def shown(self, mesh: DetailMesh, camera: CameraTensors, pixel: Int[Tensor, " R"], side: Side) -> SurfacePixels:
        """Return what rays at `pixel` of a low-resolution camera show of a hand's posed surface, and their image."""
        full, covered = doubled(camera), covered_pixels(pixel, camera.size_px)
        seen = self.backend.visible_surface(mesh, full)
        pixels = detail_pixels(covered, view_directions(full, covered), seen, mesh, full, self.skin.maps_of(side))
        return SurfacePixels(pixels, self.backend.ray_hits(mesh, camera, pixel))

    def mesh(
        self, pose: HandPose, mesh: PosedMesh, frames: LocalFrames, template: DetailTemplate | None = None
    ) -> DetailMesh:
        """Return the surface over a mesh; `template`: in how many faces, None for all of them."""
        template = self.levels(pose.side).finest if template is None else template
        return self.skin.posed(template, pose, mesh, frames, self.backend)

    def levels(self, side: Side) -> LevelsOfDetail:
        """Return the templates of a side, which are made at its first use."""
        if side not in self._levels:
            self._levels[side] = LevelsOfDetail.of(self.skin.surface, self.hand.for_side(side), self.device)
        return self._levels[side]

    def curved_faces(self, side: Side) -> CurvedFaces:
        """Return the split faces of a side's finest template, which are made at its first close-up."""
        if side not in self._curved_faces:
            self._curved_faces[side] = CurvedFaces.of(self.levels(side).finest)
        return self._curved_faces[side]

    @cached_property
    def hairs(self) -> Hairs:
        """Of either hand."""
        return hairs_on(self.skin, self.levels("right").finest)

    @cached_property
    def _levels(self) -> dict[Side, LevelsOfDetail]:
        return {}

    @cached_property
    def _curved_faces(self) -> dict[Side, CurvedFaces]:
        return {}
