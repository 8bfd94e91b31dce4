"""Where the rays of a relightable hand meet the skin, and what light reaches them there."""

from __future__ import annotations

from typing import NamedTuple

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor
from torch.nn.functional import max_pool2d, normalize

from ..compute.reference import ReferenceBackend
from ..field.field import mean_features
from ..field.rays import HandInView, RenderedRays, ray_origin
from ..field.relightable import LitField
from ..field.volume import Composite
from ..geometry.mesh import PosedMesh
from ..geometry.rasterise import NearestFronts
from ..image.maps import ray_of_pixel
from ..image.relighting import SkinDepth, neighbours
from ..light.bounce import PlacesOf, Probes, SkinPlaces, probe_vertices
from ..light.lamp_samples import LampSamples
from ..light.light_samples import LightSamples
from ..light.lighting import LightFeatures, LightShadows, ProbeLight, SurfacePoints, light_at_probes
from ..light.shadow_maps import Bounds, LightViews, PointShadows
from ..light.sky_samples import SKY_DIRECTIONS, ShadowedSky, SkySamples
from ..light.surrounding_light import SurroundingLight
from ..light.surroundings import Patches
from ..records.light import Light
from ..surface.fine_mesh import FineMesh
from ..surface.ray_hits import RayHits

SKY_MAP_PX, LAMP_MAP_PX, SOFT_MAP_PX, PROBE_MAP_PX = 64, 256, 192, 64
"""Sides of the shadow maps of one direction of the sky, and of one sample of a lamp: at rays and patches; at rays, of a
lamp whose shadows are too soft to show their pixels; at probes."""
# Template metres: how far the skin stands out of the mesh, and by how much the depths of two surfaces differ.
_STANDS_OUT_M, _EDGE_M = 0.0006, 0.003
# By how much patches lie before their surface in shadow maps: it must not shadow itself where light grazes.
_PATCH_LIFT_PX = 1.5
NO_OCCLUDERS = torch.zeros(0, 3, 3)


def occluding_triangles(light: Light, device: torch.device) -> Float[Tensor, "T 3 3"]:
    """What stands around the hand, world, m."""
    return torch.as_tensor(light.occluders, dtype=torch.float32, device=device)


def surface_points(
    field: LitField,
    gathered: Composite,
    position: Float[Tensor, "R 3"],
    view: Float[Tensor, "R 3"],
    places: SkinPlaces,
    hits: RayHits | None = None,
) -> SurfacePoints:
    """The points with the normals that were gathered along the rays.

    Args:
        field: whose rays they are.
        gathered: along the rays.
        position: as `ray_positions` gives them.
        view: unit, of the rays.
        places: on the mesh.
        hits: of the rays with a known surface; None: none is known.
    """
    normal, relief_normal = (normalize(values, dim=-1) for values in field.normals(mean_features(gathered)))
    normal = normal.detach()
    if hits is not None:
        normal = torch.where(hits.depth.isfinite()[:, None], hits.normal, normal)
    return SurfacePoints(position, normal, relief_normal, view, places)


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
    def first(self) -> SkinDepth:
        """Where rays first meet the skin: the mesh, but beside its outline the skin that may stand out of it."""
        return SkinDepth(torch.where(self._stands_out, self.outer.depth, self.mesh.depth), self.edge_m)

    @property
    def _stands_out(self) -> Tensor:
        """[P] whether skin may stand out of the mesh far before what is behind it."""
        return self.mesh.depth - self.outer.depth > self.edge_m

    def places(
        self,
        hand: HandInView,
        skin: SkinDepth,
        pixel: Int[Tensor, " R"],
        position: Float[Tensor, "R 3"],
        hits: RayHits | None = None,
        places_of: PlacesOf = SkinPlaces.of,
    ) -> SkinPlaces:
        """Where rays lie on the mesh that meet the skin there.

        Args:
            hand: in the view of these layers.
            skin: `first`, or as `seen_by` chose.
            pixel: of the rays.
            position: as `ray_positions` gives them.
            hits: as there.
            places_of: as `SkinPlaces.of`.
        """
        is_of_mesh = skin.depth[pixel] == self.mesh.depth[pixel]
        face = torch.where(is_of_mesh, self.mesh.face[pixel], self.outer.face[pixel])
        if hits is not None:
            face = torch.where(hits.is_of_other_part(skin.depth[pixel], self.edge_m), -1, face)
        return places_of(hand.mesh, hand.topology.faces, face, position)

    def seen_by(self, rays: RenderedRays, size_px: tuple[int, int]) -> SkinDepth:
        """The same, but behind what may stand out where the rays' opacity is rather there.

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


def shows_alone(
    shown: SkinDepth, depth: Float[Tensor, " R"], pixel: Int[Tensor, " R"], size_px: tuple[int, int]
) -> Bool[Tensor, " R"]:
    """Whether an image of a hand, in 3 x 3 pixels around a ray, shows nothing but the surface that the ray meets.

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


def skin_layers(backend: ReferenceBackend, hand: HandInView) -> SkinLayers:
    """The skin that the rays of all pixels may meet."""
    vertices, normals, scale = hand.mesh
    outer = hand.mesh._replace(vertices=vertices + _STANDS_OUT_M * scale * normals)
    of_mesh, of_outer = (backend.first_hit(hand._replace(mesh=mesh)) for mesh in (hand.mesh, outer))
    return SkinLayers(of_mesh, of_outer, _EDGE_M * scale)


def ray_positions(
    hand: HandInView,
    skin: SkinDepth,
    pixel: Tensor,
    directions: Float[Tensor, "R 3"],
    t: Float[Tensor, "R N"],
    dt: Float[Tensor, " R"],
    hits: RayHits | None = None,
) -> Float[Tensor, "R 3"]:
    """Where rays first meet the skin, world, m; rays that only meet the shell: the middle of their samples.

    That is on the mesh, of which shadows are cast, but where a known surface shows another part, on that surface.

    Args:
        hand: posed, in the rays' view.
        skin: at every pixel.
        pixel: of the rays.
        directions: of depth 1.
        t: depth of the samples, m; only the first is read.
        dt: their step, m.
        hits: of the rays with a known surface; None: none is known.
    """
    depth, middle = skin.depth[pixel], t[:, 0] + 0.5 * (t.shape[1] - 1) * dt
    if hits is not None:
        depth = torch.where(hits.is_of_other_part(depth, skin.edge_m), hits.depth, depth)
    depth = torch.where(depth.isfinite(), depth, middle)
    return ray_origin(hand.camera) + depth[:, None] * directions


def sky_shadows(
    backend: ReferenceBackend, hand: HandInView, occluders: Float[Tensor, "T 3 3"], position: Float[Tensor, "R 3"]
) -> PointShadows:
    """The shadows of the sky's cells at points and then at the probes, whatever light comes from there."""
    views, of_cell = ShadowedSky.of(hand.fineness.sky_directions, position.device)
    shadows = _shadows_from_afar(backend, hand, occluders, position, views)
    if len(views.distance) == SKY_DIRECTIONS:
        return shadows
    return PointShadows(shadows.lit[of_cell], shadows.depth_in_m[of_cell])


def with_parts(
    of_cells: PointShadows,
    sky: SkySamples,
    backend: ReferenceBackend,
    hand: HandInView,
    occluders: Float[Tensor, "T 3 3"],
    position: Float[Tensor, "R 3"],
) -> PointShadows:
    """The shadows of a sky's cells, which are given, and of the parts of those that are divided, as `sky_shadows`."""
    parts = torch.arange(SKY_DIRECTIONS, len(sky.towards), device=position.device)
    if not len(parts):
        return of_cells
    views = sky.views().chosen(parts)
    of_parts = _shadows_from_afar(backend, hand, occluders, position, views)
    return PointShadows(*(torch.cat(values) for values in zip(of_cells, of_parts, strict=True)))


def _shadows_from_afar(
    backend: ReferenceBackend, hand: HandInView, occluders: Tensor, position: Tensor, views: LightViews
) -> PointShadows:
    vertices = hand.mesh.vertices
    points = torch.cat([position, vertices[probe_vertices(len(vertices), hand.fineness.probes)]])
    return backend.point_shadows(hand.mesh, hand.topology.faces, occluders, views, points, SKY_MAP_PX)


class LampSkin(NamedTuple):
    """The skin that casts the shadows of lamps, on itself.

    Attributes:
        mesh: a closed surface.
        faces: [F, 3] of it.
        position: [R, 3] where the rays meet it, m, world.
    """

    mesh: PosedMesh
    faces: Tensor
    position: Tensor


class LampSkins(NamedTuple):
    """The skin that casts the shadows of hard lamps, and of soft ones."""

    hard: LampSkin
    soft: LampSkin


class HitSurface(NamedTuple):
    """A known surface, and where R rays meet it.

    Attributes:
        mesh: posed.
        position: [R, 3] m, world; of rays that miss it, somewhere beside.
    """

    mesh: FineMesh
    position: Tensor

    def lamp_skins(self, is_finest: bool) -> LampSkins:
        """A quarter of its faces with the corners where they are; for hard lamps all of them, if it is to be finest."""
        soft = self.lamp_skin(self.mesh.coarse_faces)
        return LampSkins(self.lamp_skin(self.mesh.faces) if is_finest else soft, soft)

    def lamp_skin(self, faces: Int[Tensor, "F 3"]) -> LampSkin:
        """These faces with their corners where they are on the surface; those are its first vertices."""
        count = int(faces.max()) + 1
        posed = PosedMesh(self.mesh.vertices[:count], self.mesh.normals[:count], self.mesh.scale)
        return LampSkin(posed, faces, self.position)


def light_shadows(
    backend: ReferenceBackend,
    hand: HandInView,
    light: LightSamples,
    occluders: Float[Tensor, "T 3 3"],
    position: Float[Tensor, "R 3"],
    of_sky: PointShadows,
    albedo: Tensor,
    shining_on_probes: LampSamples | None = None,
    lamp_skins: LampSkins | None = None,
) -> LightShadows:
    """The shadows of a light at points, by the hand itself and by occluders.

    Args:
        backend: computes them.
        hand: posed.
        light: sampled.
        occluders: what else stands in its way.
        position: of the points, m, world.
        of_sky: as `sky_shadows` gives them.
        albedo: of the skin that sheds light on itself, [V, 3] of the vertices or [3] of all.
        shining_on_probes: the lamps as they light that skin, in fewer samples; None: as everywhere.
        lamp_skins: cast and take their shadows; None: the mesh does, at the points.
    """
    probes, bounds = Probes.of(hand.mesh, hand.topology, hand.fineness.probes), Bounds.of(hand.mesh)

    def cast(views: LightViews, skin: LampSkin, map_px: int) -> PointShadows:
        return backend.point_shadows(skin.mesh, skin.faces, occluders, views, skin.position, map_px, bounds)

    def of_lamps(lamps: LampSamples, skins: LampSkins, hard_px: int, soft_px: int) -> PointShadows:
        views, is_hard = lamps.views(bounds), lamps.is_hard
        if is_hard.all() or (skins.hard is skins.soft and hard_px == soft_px):
            return cast(views, skins.hard, hard_px)
        if not is_hard.any():
            return cast(views, skins.soft, soft_px)
        soft, hard = ((~is_hard).nonzero()[:, 0], is_hard.nonzero()[:, 0])
        parts = (cast(views.chosen(soft), skins.soft, soft_px), cast(views.chosen(hard), skins.hard, hard_px))
        order = torch.cat([soft, hard]).argsort()
        return PointShadows(*(torch.cat(values)[order] for values in zip(*parts, strict=True)))

    on_mesh = LampSkin(hand.mesh, hand.topology.faces, position)
    at_probes = on_mesh._replace(position=probes.position)
    # Apart, for a map is as fine as its points are near.
    lamps = of_lamps(light.lamps, lamp_skins or LampSkins(on_mesh, on_mesh), LAMP_MAP_PX, SOFT_MAP_PX)
    probe_light = light._replace(lamps=light.lamps if shining_on_probes is None else shining_on_probes)
    probe_lamps = of_lamps(probe_light.lamps, LampSkins(at_probes, at_probes), PROBE_MAP_PX, PROBE_MAP_PX)
    sky, probe_sky = split_points(of_sky, len(position))
    of_probes = light_at_probes(probe_light, probe_sky, probe_lamps, probes)
    of_discs = albedo if albedo.dim() == 1 else albedo[probes.chosen]
    return LightShadows(sky, lamps, ProbeLight(probes, of_discs, *of_probes))


def surrounding_light(
    backend: ReferenceBackend,
    hand: HandInView,
    samples: LightSamples,
    light: Light,
) -> SurroundingLight | None:
    """What stands around a hand, and what it receives from a light; None: nothing does that would shed any.

    Args:
        backend: computes the shadows.
        hand: posed.
        samples: of the light, or of several among the same occluders.
        light: whose occluders count.
    """
    patches = Patches.around(light, hand.mesh.vertices)
    if len(patches.position) == 0:
        return None
    points, occluders = patches.points, occluding_triangles(light, patches.position.device)
    bounds = Bounds.around(torch.cat([points.position, hand.mesh.vertices]))

    def cast(views: LightViews, map_px: int) -> PointShadows:
        lift_m = torch.minimum(_PATCH_LIFT_PX * 2 * bounds.radius / map_px, 0.5 * points.area_m2.sqrt())
        lifted = points.position + lift_m[:, None] * points.normal
        return backend.point_shadows(hand.mesh, hand.topology.faces, occluders, views, lifted, map_px, bounds)

    sky, lamps = cast(samples.sky.views(), SKY_MAP_PX), cast(samples.lamps.views(bounds), LAMP_MAP_PX)
    received = light_at_probes(samples, sky, lamps, points.probes)
    return SurroundingLight(patches, *(patches.mean(values) for values in received))


def features_among(
    around: SurroundingLight | None,
    light: LightSamples,
    shadows: LightShadows,
    open_sky: PointShadows,
    points: SurfacePoints,
    backend: ReferenceBackend,
) -> LightFeatures:
    """What a light does at points, and what stands around with it: on them, and on the skin that sheds light on them.

    Args:
        around: what stands around, if anything does.
        light: sampled.
        shadows: at the points.
        open_sky: shadows of the sky by the hand alone, as `sky_shadows` gives them.
        points: on the skin.
        backend: computes the features.
    """
    if around is None:
        return backend.light_features(light, shadows, points)
    skin = shadows.probes
    shed = around.shed(light, skin, backend.bounced)
    at_points, at_probes = split_points(open_sky, len(points.position))
    on_probes = backend.near_light(around.patches, at_probes, shed, SurfacePoints.of(skin.probes))
    skin = skin._replace(besides=on_probes.diffuse(skin.probes.normal))
    features = backend.light_features(light, shadows._replace(probes=skin), points)
    return backend.near_light(around.patches, at_points, shed, points).added_to(features)


def split_points(shadows: PointShadows, count: int) -> tuple[PointShadows, PointShadows]:
    """The shadows at the first `count` points, and at the others."""
    lit, depth_in_m = shadows
    first = PointShadows(lit[:, :count], depth_in_m[:, :count])
    return first, PointShadows(lit[:, count:], depth_in_m[:, count:])
