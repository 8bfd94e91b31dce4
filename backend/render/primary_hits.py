"""Where the rays of a view first meet the skin: the points that are lit, and the surface that casts lamps' shadows.

Rays are given by the mesh, the avatar's surface, and the opacity along them. `primary_hits` is the road of frames and
of training alike; they differ in what is explicit: frames give rendered rays as `shown`, whose opacity decides what a
ray beside an outline shows; training does not, for its positions and shadows are kept while opacities are learnt.
"""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import max_pool2d, normalize

from ..compute.reference import ReferenceBackend
from ..field.field import mean_features
from ..field.rays import HandInView, RenderedRays, SurfaceRays, ray_directions, ray_origins
from ..field.relightable import RelightableField
from ..field.volume import Composite
from ..geometry.mesh import PosedMesh
from ..geometry.rasterise import NearestFronts
from ..image.maps import ray_of_pixel
from ..image.shading import SurfaceDepth, at_full_size, neighbours
from ..light.indirect_diffuse import MeshPoints, MeshPointsOf
from ..light.lighting import SurfacePoints
from ..surface.detail_mesh import DetailMesh
from ..surface.hole_filling import own_share
from ..surface.ray_hits import RayHits

STANDS_OUT_M, EDGE_M = 0.0006, 0.003
"""Template metres: how far the skin stands out of the mesh, and by how much the depths of two surfaces differ."""


class PrimaryHits(NamedTuple):
    """Where the R rays of a view first meet the skin.

    Attributes:
        hand: posed, in the rays' view.
        pixel: [R] of the rays.
        view: [R, 3] unit, from the camera, world.
        position: [R, 3] as `ray_positions` gives them, m, world.
        hit_points: of these on the mesh.
        mesh_depth: of the mesh at the view's pixels.
        hits: of the rays with the avatar's surface; None: it has none.
    """

    hand: HandInView
    pixel: Tensor
    view: Tensor
    position: Tensor
    hit_points: MeshPoints
    mesh_depth: SurfaceDepth
    hits: RayHits | None

    def on_surface(self, mesh: DetailMesh) -> HitSurface:
        """Return the avatar's posed surface with the rays' points on it; it must be the one whose `hits` these have."""
        assert self.hits is not None
        camera = self.hand.camera
        origins, directions = ray_origins(camera, self.pixel), ray_directions(camera, self.pixel)
        return HitSurface(mesh, self.hits.positions(origins, directions, self.position))


def primary_hits(
    backend: ReferenceBackend,
    hand: HandInView,
    rays: RenderedRays | SurfaceRays,
    hits: RayHits | None,
    shown: RenderedRays | None,
    points_of: MeshPointsOf,
) -> PrimaryHits:
    """Find where rays first meet the skin.

    Args:
        backend: rasterises.
        hand: posed, in the rays' view.
        rays: sampled.
        hits: of the rays with the avatar's surface; None: it has none.
        shown: the rays rendered, whose opacity decides which of two surfaces one shows; None: the nearer one.
        points_of: as `MeshPoints.of`.
    """
    layers, directions = skin_layers(backend, hand), ray_directions(hand.camera, rays.pixel)
    skin = layers.first if shown is None else layers.visible_to(shown, hand.camera.size_px)
    position = ray_positions(hand, skin, rays.pixel, directions, rays.t, rays.dt, hits)
    hit_points = layers.hit_points(hand, skin, rays.pixel, position, hits, points_of)
    view, mesh_depth = normalize(directions, dim=-1), SurfaceDepth(layers.mesh.depth, layers.edge_m)
    return PrimaryHits(hand, rays.pixel, view, position, hit_points, mesh_depth, hits)


def skin_at_full_size(backend: ReferenceBackend, hand: HandInView, shown: RenderedRays | None) -> SurfaceDepth:
    """Return the skin's depth in the image of twice the size; `shown` as in `primary_hits`."""
    layers = skin_layers(backend, at_full_size(hand))
    return layers.first if shown is None else layers.visible_to(shown, hand.camera.size_px)


class SkinLayers(NamedTuple):
    """The skin in an image of P pixels.

    Attributes:
        mesh: the mesh.
        outer: the mesh with all skin that may stand out of it.
        edge_m: [] depths that differ by more are of two surfaces.
    """

    mesh: NearestFronts
    outer: NearestFronts
    edge_m: Tensor

    @property
    def first(self) -> SurfaceDepth:
        """Where rays first meet the skin: the mesh, but beside its outline the skin that may stand out of it."""
        return SurfaceDepth(torch.where(self._stands_out, self.outer.depth, self.mesh.depth), self.edge_m)

    @property
    def _stands_out(self) -> Tensor:
        """[P] whether skin may stand out of the mesh far before what is behind it."""
        return self.mesh.depth - self.outer.depth > self.edge_m

    def hit_points(
        self,
        hand: HandInView,
        skin: SurfaceDepth,
        pixel: Int[Tensor, " R"],
        position: Float[Tensor, "R 3"],
        hits: RayHits | None = None,
        points_of: MeshPointsOf = MeshPoints.of,
    ) -> MeshPoints:
        """Find where rays lie on the mesh that meet the skin there.

        Args:
            hand: in the view of these layers.
            skin: `first`, or as `visible_to` chose.
            pixel: of the rays.
            position: as `ray_positions` gives them.
            hits: as there.
            points_of: as `MeshPoints.of`.
        """
        is_of_mesh = skin.depth[pixel] == self.mesh.depth[pixel]
        face = torch.where(is_of_mesh, self.mesh.face[pixel], self.outer.face[pixel])
        if hits is not None:
            face = torch.where(hits.is_of_other_part(skin.depth[pixel], self.edge_m), -1, face)
        return points_of(hand.mesh, hand.topology.faces, face, position)

    def visible_to(self, rays: RenderedRays, size_px: tuple[int, int]) -> SurfaceDepth:
        """Return `first`, but the skin behind what may stand out where the rays' opacity is rather there.

        A ray that passes a finger's outline shows the palm behind it, and has the palm's shadow.

        Args:
            rays: rendered.
            size_px: of the rays' image; these layers are of that size, or twice as large.
        """
        at = self._stands_out.nonzero()[:, 0]
        mesh, outer = self.mesh.depth, self.outer.depth
        at = at[mesh[at] < torch.inf]
        is_of_rays = len(mesh) == size_px[0] * size_px[1]
        around, share = (at[:, None], torch.ones_like(mesh[at, None])) if is_of_rays else neighbours(at, size_px)
        ray = ray_of_pixel(rays.pixel, size_px[0] * size_px[1])[around]
        opacity = rays.composite.weights[ray].float() * (share * (ray >= 0))[..., None]
        is_behind = rays.t[ray] > (0.5 * (mesh + outer))[at, None, None]
        shows_behind = (opacity * is_behind).sum((1, 2)) > 0.5 * opacity.sum((1, 2))
        first = self.first
        return first._replace(depth=first.depth.index_put((at,), torch.where(shows_behind, mesh[at], outer[at])))


def skin_layers(backend: ReferenceBackend, hand: HandInView) -> SkinLayers:
    """Find the skin that the rays of all pixels may meet."""
    vertices, normals, scale = hand.mesh
    outer = hand.mesh._replace(vertices=vertices + STANDS_OUT_M * scale * normals)
    of_mesh, of_outer = (backend.first_hit(hand._replace(mesh=mesh)) for mesh in (hand.mesh, outer))
    return SkinLayers(of_mesh, of_outer, EDGE_M * scale)


def is_off_edges(
    shown: SurfaceDepth, depth: Float[Tensor, " R"], pixel: Int[Tensor, " R"], size_px: tuple[int, int]
) -> Bool[Tensor, " R"]:
    """Return whether an image of a hand, in 3 x 3 pixels around a ray, shows only the surface that the ray meets.

    Args:
        shown: at its pixels; its depth is infinite beside the hand.
        depth: where the rays meet the surface, m.
        pixel: of the rays.
        size_px: of the image.
    """
    there = shown.depth.view(1, 1, size_px[1], size_px[0])
    far = max_pool2d(torch.where(there.isfinite(), there, -torch.inf), 3, 1, 1).flatten()[pixel]
    near = -max_pool2d(-there, 3, 1, 1).flatten()[pixel]
    return (far - depth <= shown.edge_m) & (depth - near <= shown.edge_m) & far.isfinite()


def ray_positions(
    hand: HandInView,
    skin: SurfaceDepth,
    pixel: Tensor,
    directions: Float[Tensor, "R 3"],
    t: Float[Tensor, "R N"],
    dt: Float[Tensor, " R"],
    hits: RayHits | None = None,
) -> Float[Tensor, "R 3"]:
    """Find where rays first meet the skin, world, m; rays that only meet the shell: the middle of their samples.

    That is on the mesh, of which shadows are cast, but where an avatar's surface shows another part, on that surface.

    Args:
        hand: posed, in the rays' view.
        skin: at every pixel.
        pixel: of the rays.
        directions: of depth 1.
        t: depth of the samples, m; only the first is read.
        dt: their step, m.
        hits: of the rays with the avatar's surface; None: it has none.
    """
    depth, middle = skin.depth[pixel], t[:, 0] + 0.5 * (t.shape[1] - 1) * dt
    if hits is not None:
        depth = torch.where(hits.is_of_other_part(depth, skin.edge_m), hits.depth, depth)
    depth = torch.where(depth.isfinite(), depth, middle)
    return ray_origins(hand.camera, pixel) + depth[:, None] * directions


def surface_points(
    field: RelightableField,
    gathered: Composite,
    position: Float[Tensor, "R 3"],
    view: Float[Tensor, "R 3"],
    hit_points: MeshPoints,
    hits: RayHits | None = None,
) -> SurfacePoints:
    """Make points with the normals that were gathered along the rays.

    Rays that are all but transparent where they meet the surface gathered next to nothing: they have its normal.

    Args:
        field: whose rays they are.
        gathered: along the rays.
        position: as `ray_positions` gives them.
        view: unit, of the rays.
        hit_points: on the mesh.
        hits: of the rays with the avatar's surface; None: it has none.
    """
    normal, relief_normal = (normalize(values, dim=-1) for values in field.normals(mean_features(gathered)))
    normal = normal.detach()
    if hits is not None:
        normal = torch.where(hits.depth.isfinite()[:, None], hits.normal, normal)
        own = own_share(gathered.alpha.detach(), hits)[:, None]
        relief_normal = torch.where(own < 1, normalize(torch.lerp(normal, relief_normal, own), dim=-1), relief_normal)
    return SurfacePoints(position, normal, relief_normal, view, hit_points)


class LampShadowCaster(NamedTuple):
    """The skin that casts the shadows of lamps, on itself.

    Attributes:
        mesh: a closed surface.
        faces: [F, 3] of it.
        position: [R, 3] where the rays meet it, m, world.
    """

    mesh: PosedMesh
    faces: Tensor
    position: Tensor


class LampShadowCasters(NamedTuple):
    """The skin that casts the shadows of hard lamps, and of soft ones."""

    hard: LampShadowCaster
    soft: LampShadowCaster


class HitSurface(NamedTuple):
    """An avatar's surface, and where R rays meet it.

    Attributes:
        mesh: posed.
        position: [R, 3] m, world; of rays that miss it, somewhere beside.
    """

    mesh: DetailMesh
    position: Tensor

    def shadow_casters(self, is_finest: bool) -> LampShadowCasters:
        """Return a quarter of the faces with corners unmoved; for hard lamps all, if it is to be finest."""
        soft = self.shadow_caster(self.mesh.coarse_faces)
        return LampShadowCasters(self.shadow_caster(self.mesh.faces) if is_finest else soft, soft)

    def shadow_caster(self, faces: Int[Tensor, "F 3"]) -> LampShadowCaster:
        """Make a caster of these faces with corners where they are on the surface; those are its first vertices."""
        count = int(faces.max()) + 1
        posed = PosedMesh(self.mesh.vertices[:count], self.mesh.normals[:count], self.mesh.scale)
        return LampShadowCaster(posed, faces, self.position)
