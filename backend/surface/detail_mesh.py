"""The detail mesh of an avatar: subdivided and displaced, posed after the template's mesh, and what a view shows.

It adds what neither the field's planes nor its mesh resolve: the normals of knuckles, tendons and veins that a
pose raises, and the exact outline.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.nn.functional import conv2d

from ..field.rays import CameraTensors, HandInView, project
from ..geometry.local_rotation import LocalFrames, local_rotations
from ..geometry.loop import LoopStep, loop_step, split_corners
from ..geometry.mesh import PosedMesh, vertex_normals
from ..geometry.rasterise import NearestFronts, nearest_fronts, rasterise
from ..hand.lbs import SkinMotion, SkinTensors
from ..hand.model import MIRROR_POINT, HandModel
from ..records.errors import LiveHandError
from .detail_surface import LEVELS, DetailSurface
from .edge_antialiasing import SPREAD, EdgePixels, SurfaceBones, SurfaceFragments

SAMPLES = tuple(((k + 0.5) / 16, (int(f"{k:04b}"[::-1], 2) + 0.5) / 16) for k in range(16))
"""Where in a pixel on the outline the surface is looked for: Hammersley's points, of which each 16th of a pixel's width
and of its height has one."""


MOST_EDGE_PX = 1.0
"""Of a coarser surface, in the image of rays: a finger's outline is then within a twentieth of a pixel."""


CLOSE_M, FAR_M = 0.0005, 0.0015
"""Template metres between mesh and surface: rays meet the mesh up to the first, the surface from the second on."""


class SubdivisionLevel(NamedTuple):
    """One level of subdivision, as it makes a field of N vertices out of one of V.

    Attributes:
        row: [K] in N, ascending.
        column: [K] in V.
        weight: [K]; those of a row sum to 1.
        start: [N + 1] of each row's entries.
    """

    row: Tensor
    column: Tensor
    weight: Tensor
    start: Tensor

    @classmethod
    def of(cls, step: LoopStep) -> SubdivisionLevel:
        """Build the weights of a level."""
        order = np.lexsort((step.column, step.row))
        row, start = step.row[order], np.searchsorted(step.row[order], np.arange(step.vertex_count + 1))
        weight = torch.as_tensor(step.value[order], dtype=torch.float32)
        return cls(torch.as_tensor(row), torch.as_tensor(step.column[order]), weight, torch.as_tensor(start))

    def to(self, device: torch.device | str) -> SubdivisionLevel:
        """Move the level to a device."""
        return SubdivisionLevel(*(tensor.to(device) for tensor in self))

    def first(self, count: int) -> SubdivisionLevel:
        """Restrict the level to the first of the finer vertices."""
        entries = int(self.start[count])
        return SubdivisionLevel(*(values[:entries] for values in self[:3]), start=self.start[: count + 1])

    def __call__(self, values: Float[Tensor, "V C"]) -> Float[Tensor, "N C"]:
        """Interpolate the field at the finer vertices."""
        finer = values.new_zeros(len(self.start) - 1, values.shape[1])
        return finer.index_add(0, self.row, self.weight[:, None] * values[self.column])


class DetailTemplate(NamedTuple):
    """What all poses of a detail surface share: N vertices, M faces.

    Attributes:
        skin: of the mesh that is subdivided.
        mirror: [3] factors that turn the right hand into this side's.
        levels: of Loop's subdivision, from the V vertices of the mesh to the N.
        faces: [M, 3].
        corner_uv: [M, 3, 2].
        around: [N + 1] where each vertex's faces begin among these, and [3 M] the faces around all vertices.
        offset_m: [N, 3] from there to the surface at rest.
        normals: [N, 3] unit, at rest; heights lie along them.
        bones: that its faces follow.
        coarse_faces: [M / 4, 3] of one level less, whose vertices are the first.
    """

    skin: SkinTensors
    mirror: Tensor
    levels: tuple[SubdivisionLevel, ...]
    faces: Tensor
    corner_uv: Tensor
    around: tuple[Tensor, Tensor]
    offset_m: Tensor
    normals: Tensor
    bones: SurfaceBones
    coarse_faces: Tensor

    @classmethod
    def of(cls, surface: DetailSurface, model: HandModel, device: torch.device | str = "cpu") -> DetailTemplate:
        """Build the template of a hand of either side; the surface is that of the right hand.

        Raises:
            LiveHandError: the surface is of a mesh of another size.
        """
        skin, faces, corner_uv, levels = SkinTensors.of(model, device), model.f, model.vt[model.ft], []
        rest, weights, coarse_faces = skin.v_template, skin.lbs_weights, faces
        for _ in range(LEVELS):
            step = loop_step(faces, len(rest))
            levels.append(SubdivisionLevel.of(step).to(device))
            rest, weights = levels[-1](rest), levels[-1](weights)
            coarse_faces, faces, corner_uv = faces, step.faces, split_corners(corner_uv)
        if len(surface.offset_m) != len(rest):
            raise LiveHandError(
                f"the surface must have the {len(rest)} vertices of '{model.name}', twice subdivided, got "
                f"{len(surface.offset_m)}; give the surface of this hand"
            )
        mirror = torch.as_tensor(MIRROR_POINT if model.side == "left" else np.ones(3)).to(rest)
        offset, indices = torch.as_tensor(surface.offset_m).to(rest) * mirror, torch.as_tensor(faces, device=device)
        return cls(
            skin=skin,
            mirror=mirror,
            levels=tuple(levels),
            faces=indices,
            corner_uv=torch.as_tensor(corner_uv).to(rest),
            around=faces_around(indices, len(rest)),
            offset_m=offset,
            normals=vertex_normals(rest + offset, indices),
            bones=SurfaceBones.of(weights, indices, skin.parents),
            coarse_faces=torch.as_tensor(coarse_faces, device=device),
        )

    def coarser(self) -> DetailTemplate:
        """Return the surface in a quarter of its faces, with their corners unmoved."""
        count, faces = int(self.coarse_faces.max()) + 1, len(self.coarse_faces)
        corner_uv = self.corner_uv.unflatten(0, (4, faces))[:3, :, 0].transpose(0, 1)
        of_middle_faces = self.bones.of_face[3 * faces :]
        return self._replace(
            levels=(*self.levels[:-1], self.levels[-1].first(count)),
            faces=self.coarse_faces,
            corner_uv=corner_uv.contiguous(),
            around=faces_around(self.coarse_faces, count),
            offset_m=self.offset_m[:count],
            normals=self.normals[:count],
            bones=self.bones._replace(of_face=of_middle_faces),
        )

    def rest_vertices(self) -> Float[Tensor, "N 3"]:
        """Compute the vertices at rest, m, in the template's frame."""
        finer = self.skin.v_template
        for level in self.levels:
            finer = level(finer)
        return finer + self.offset_m


class LevelsOfDetail(NamedTuple):
    """The templates of one surface, for images of any size."""

    finest: DetailTemplate
    coarser: DetailTemplate

    @classmethod
    def of(cls, surface: DetailSurface, model: HandModel, device: torch.device | str) -> LevelsOfDetail:
        """Build both templates of a hand of either side."""
        finest = DetailTemplate.of(surface, model, device)
        return cls(finest, finest.coarser())

    def visible_in(self, hand: HandInView) -> DetailTemplate:
        """Choose the coarser template if none of its edges is longer in the image than a few pixels."""
        mesh, topology, camera = hand[:3]
        nearest_m = camera.divisor(mesh.vertices @ camera.world2cam[2, :3] + camera.world2cam[2, 3]).min()
        edge_m = mesh.scale * topology.edge_length_m / 2
        return self.coarser if edge_m * camera.focal_px < MOST_EDGE_PX * nearest_m else self.finest


class DetailMesh(NamedTuple):
    """A detail surface in one pose.

    Attributes:
        vertices: [N, 3] m, world.
        normals: [N, 3] unit, outward.
        faces: [M, 3].
        corner_uv: [M, 3, 2].
        flex: [N] bend of the skin (`SkinFlexion.flex`).
        scale: [] against the template.
        bones: that its faces follow.
        coarse_faces: as in `DetailTemplate`.
    """

    vertices: Tensor
    normals: Tensor
    faces: Tensor
    corner_uv: Tensor
    flex: Tensor
    scale: Tensor
    bones: SurfaceBones
    coarse_faces: Tensor


class PixelSurface(NamedTuple):
    """What the P pixels of an image show of a surface.

    Attributes:
        face: [P] the nearest front face at the pixel's centre, -1 for none.
        depth: [P] of it, m; infinite for none, unless the pixel shows what its centre misses: then the nearest beside.
        coverage: [P] share of the pixel that the surface covers, as Cycles' filter has it.
        edges: where one part of the surface ends before or against another.
    """

    face: Tensor
    depth: Tensor
    coverage: Tensor
    edges: EdgePixels


def detail_mesh(
    template: DetailTemplate,
    motion: SkinMotion,
    height_m: Float[Tensor, " N"],
    flex: Float[Tensor, " V"],
    scale: Float[Tensor, ""],
) -> DetailMesh:
    """Compute the detail mesh over a posed mesh.

    Linear blend skinning of the finer vertices: a finer vertex's weights, and so its transform, are means of those of
    the mesh's vertices as its position is.

    Args:
        template: of the mesh's side.
        motion: of the mesh.
        height_m: what rises on the surface (`PoseDisplacement.height_mm`), template metres.
        flex: bend of the skin at the mesh's vertices.
        scale: of the mesh against the template.
    """
    values = torch.cat([motion.rest, motion.transforms.flatten(1), flex[:, None]], 1)
    for level in template.levels:
        values = level(values)
    rest = values[:, :3] + template.offset_m + height_m[:, None] * template.normals
    transforms = values[:, 3:15].reshape(-1, 3, 4)
    vertices = (transforms[..., :3] * rest[:, None]).sum(-1) + transforms[..., 3]
    normals = vertex_normals(vertices, template.faces)
    shared = template.bones, template.coarse_faces
    return DetailMesh(vertices, normals, template.faces, template.corner_uv, values[:, 15], scale, *shared)


def on_surface(hand: HandInView, surface: DetailMesh, depth: Float[Tensor, " P"]) -> HandInView:
    """Return the hand as rays of its field meet it: they end on the avatar's surface, which the field follows.

    A field is defined within its shell about the mesh, and a fist's knuckles stand out of that. Where the surface is
    far from the mesh, the mesh is moved onto it, and close to it stays: there the field has learnt how skin rises.

    Args:
        hand: posed; its vertices are the first of the surface's.
        surface: over its mesh.
        depth: of the surface at the pixels' centres, m; infinite where there is none.
    """
    vertices, normals, scale = hand.mesh
    off_m = ((surface.vertices[: len(vertices)] - vertices) * normals).sum(1, keepdim=True)
    share = ((off_m.abs() / scale - CLOSE_M) / (FAR_M - CLOSE_M)).clamp(0, 1)
    moved = vertices + share * share * (3 - 2 * share) * off_m * normals
    return hand._replace(mesh=hand.mesh._replace(vertices=moved), surface_depth=depth)


def skin_motion_of(template: DetailTemplate, mesh: PosedMesh, frames: LocalFrames) -> SkinMotion:
    """Recover the motion of a mesh that not only its pose moved: by the rotation of the surface about each vertex.

    Args:
        template: of the mesh's side.
        mesh: sculpted, scaled or of a retargeted rig.
        frames: of the mesh's topology.
    """
    rest = template.skin.v_template
    turned = mesh.scale * local_rotations(mesh.vertices, mesh.normals, frames) * template.mirror
    return SkinMotion(rest, torch.cat([turned, mesh.vertices[..., None] - turned @ rest[..., None]], -1))


def visible_surface(mesh: DetailMesh, camera: CameraTensors) -> PixelSurface:
    """Find what the camera's pixels show of the mesh."""
    (width, height), projected = camera.size_px, project(camera, mesh.vertices)
    depth_at, face = first_fronts(mesh, *projected, camera)
    is_seen = face >= 0
    depths, faces = zip(*(first_fronts(mesh, *projected, camera, sample) for sample in SAMPLES), strict=True)
    samples = SurfaceFragments(torch.stack(depths), mesh.bones.at(torch.stack(faces)))
    covered = samples.depth.isfinite().float().mean(0)
    edges = EdgePixels.of(SurfaceFragments(depth_at, mesh.bones.at(face)), samples, mesh.bones, camera, mesh.scale)
    inside = is_seen.float().reshape(1, 1, height, width)
    within = -torch.nn.functional.max_pool2d(-inside, 3, 1, 1)  # beyond the image is as its rim
    around = torch.nn.functional.max_pool2d(inside, 3, 1, 1)
    on_outline = (within != around).flatten()
    coverage = spread(torch.where(on_outline, covered, is_seen.float()), camera.size_px)
    beside = -torch.nn.functional.max_pool2d(-depth_at.reshape(1, 1, height, width), 3, 1, 1).flatten()
    depth_at = torch.where(is_seen | (coverage <= 0), depth_at, beside)
    return PixelSurface(face, depth_at, coverage, edges)


def first_fronts(
    mesh: DetailMesh,
    positions_px: Float[Tensor, "N 2"],
    depth: Float[Tensor, " N"],
    camera: CameraTensors,
    place: tuple[float, float] = (0.5, 0.5),
) -> NearestFronts:
    """Find the first front faces at a point in each pixel, by default its centre."""
    moved = positions_px + 0.5 - positions_px.new_tensor(place)
    fragments = rasterise(moved, depth, mesh.faces, camera.size_px, camera.is_orthographic)
    return nearest_fronts(fragments, camera.size_px)


def spread(coverage: Float[Tensor, " P"], size_px: tuple[int, int]) -> Float[Tensor, " P"]:
    """Spread the coverage of pixels' squares as Cycles' filter would; the image's rim goes on beyond it."""
    width, height = size_px
    kernel = coverage.new_tensor(SPREAD)
    image = torch.nn.functional.pad(coverage.reshape(1, 1, height, width), (1, 1, 1, 1), mode="replicate")
    return conv2d(conv2d(image, kernel.reshape(1, 1, 1, 3)), kernel.reshape(1, 1, 3, 1)).flatten()


def faces_around(faces: Int[Tensor, "M 3"], count: int) -> tuple[Tensor, Tensor]:
    """Find the faces around vertices, as `DetailTemplate.around`."""
    corners = faces.flatten()
    start = torch.zeros(count + 1, dtype=torch.long, device=faces.device)
    start[1:] = torch.cumsum(torch.bincount(corners, minlength=count), 0)
    return start, torch.argsort(corners, stable=True) // 3


def barycentric(
    mesh: DetailMesh, camera: CameraTensors, face: Int[Tensor, " K"], pixel: Int[Tensor, " K"]
) -> Float[Tensor, "K 3"]:
    """Compute barycentric coordinates, in space, of the points of faces that are seen in pixels' centres.

    In double precision, since a face that is seen from its side is thin in the image.
    """
    finely = camera._replace(K=camera.K.double(), world2cam=camera.world2cam.double())
    corners, depth = project(finely, mesh.vertices[mesh.faces[face]].double())
    width = camera.size_px[0]
    centre = torch.stack([pixel % width, torch.div(pixel, width, rounding_mode="floor")], -1).double() + 0.5
    a, b, c = corners.unbind(1)
    of_corners = torch.stack([_cross(c - b, centre - b), _cross(a - c, centre - c), _cross(b - a, centre - a)], -1)
    weights = of_corners / camera.divisor(depth)
    return (weights / weights.sum(-1, keepdim=True)).to(mesh.vertices.dtype)


def blend_corners(corners: Float[Tensor, "K 3 C"], weights: Float[Tensor, "K 3"]) -> Float[Tensor, "K C"]:
    """Interpolate values at points of faces from those at corners by barycentric coordinates."""
    return (corners * weights[..., None]).sum(1)


def _cross(a: Tensor, b: Tensor) -> Tensor:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
