"""What kernels are given, as named tuples of arrays: kernels read their fields by name."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class ProjectedMesh(NamedTuple):
    """A mesh before a camera: positions_px [V, 2], depth [V] m, faces [F, 3]."""

    positions_px: np.ndarray
    depth: np.ndarray
    faces: np.ndarray


class ShellCrossings(NamedTuple):
    """The rasterised shell over P pixels of a view.

    Attributes:
        depth: [P, L] crossings of the inflated mesh, nearest first, m.
        face: [P, L] their faces; a back face f is stored as -1 - f.
        counts: [P] number of crossings.
        inner: [P] depth of the deflated mesh's first front face, m; infinite where there is none.
        known: [P] depth of a known surface, m; infinite where there is none.
        before: as `field.sampler.BEFORE_M`, m.
        behind: as `field.sampler.BEHIND_M`, m.
        least_reach: as `field.sampler.LEAST_REACH_M`, m.
    """

    depth: np.ndarray
    face: np.ndarray
    counts: np.ndarray
    inner: np.ndarray
    known: np.ndarray
    before: np.float32
    behind: np.float32
    least_reach: np.float32


class SurfaceTables(NamedTuple):
    """A posed mesh prepared for closest-point searches.

    Attributes:
        shapes: [F, 13] constants of each face (`surface.face_shapes`).
        around: [F, 13, K] the same of the faces around each, side by side.
        neighbours: [F, 1 + K] each face and the faces around it.
        faces: [F, 3].
        vertices: [V, 3] m.
        normals: [V, 3].
    """

    shapes: np.ndarray
    around: np.ndarray
    neighbours: np.ndarray
    faces: np.ndarray
    vertices: np.ndarray
    normals: np.ndarray


class Skin(NamedTuple):
    """Values on the surface: corner_uv [F, 3, 2]; channels [V, C]: normal 3, rotation 9, local pose, light."""

    corner_uv: np.ndarray
    channels: np.ndarray


class Rays(NamedTuple):
    """Rays of a view: pixel [R], directions [R, 3] of depth 1, origin [3] m."""

    pixel: np.ndarray
    directions: np.ndarray
    origin: np.ndarray


class RayUnits(NamedTuple):
    """What all rays share.

    Attributes:
        samples: per ray.
        shell_m: half-width of the shell.
        focal_px: focal length.
        scale: of the posed hand to its template.
    """

    samples: int
    shell_m: np.float32
    focal_px: np.float32
    scale: np.float32


class PackedField(NamedTuple):
    """Tables and weights of a field of planes.

    Attributes:
        table: flat texels of all planes, the relief's last, channels padded to whole blocks; fp32, or the bits of half
            precision.
        layout: [planes, 5] start in the table, resolution, heights, channels with padding, channels without.
        texels_m: [planes] size of a texel on the skin.
        relief_gain: factor of the relief.
        pose_channels: of the local pose.
        near_bias: [hidden], padded with zeros to whole blocks.
        near_weight: [1, inputs, hidden].
        density_weight: [hidden].
        density_bias: of the density.
        slope: of the density's prior over height.
        prior: its offset.
    """

    table: np.ndarray
    layout: np.ndarray
    texels_m: np.ndarray
    relief_gain: np.float32
    pose_channels: int
    near_bias: np.ndarray
    near_weight: np.ndarray
    density_weight: np.ndarray
    density_bias: np.float32
    slope: np.float32
    prior: np.float32


class RayBuffers(NamedTuple):
    """What the samples of one ray are computed in.

    Attributes:
        start: [L] of its intervals, m.
        end: [L] m.
        since: [L] depth at which it enters the shell there, m.
        part: [L] the current face of each part that it has entered.
        tried: [3, K] distances^2 and weights of the faces around.
        gathered: [features].
        channels: [C] of the skin.
        relief: [4].
        hidden: [hidden] of the density.
    """

    start: np.ndarray
    end: np.ndarray
    since: np.ndarray
    part: np.ndarray
    tried: np.ndarray
    gathered: np.ndarray
    channels: np.ndarray
    relief: np.ndarray
    hidden: np.ndarray


class RayOutputs(NamedTuple):
    """What rendered rays are written to; features and weights are zero at the start.

    Attributes:
        features: [R, K] composited gathered features.
        alpha: [R].
        depth: [R] mean depth, m.
        weights: [R, N] zero behind the sample at which a ray becomes opaque.
        t: [R, N] depth of each sample, m; not written behind that sample.
        dt: [R] m.
    """

    features: np.ndarray
    alpha: np.ndarray
    depth: np.ndarray
    weights: np.ndarray
    t: np.ndarray
    dt: np.ndarray


class ShadowPoints(NamedTuple):
    """As `light.visibility.ShadowMapPoints`: px and lifted_px [K, V, 2], depth and lifted_depth [K, V], bias."""

    px: np.ndarray
    depth: np.ndarray
    lifted_px: np.ndarray
    lifted_depth: np.ndarray
    bias: np.float32


class ShadowCasters(NamedTuple):
    """As `light.shadow_maps.ShadowScene`; lengths are in radii.

    Attributes:
        frames: [K, 3, 3] of the views.
        distance: [K] of the light.
        vertices: [3, V] of the mesh.
        faces: [F, 3] of the mesh.
        others: [3, 3 T] corners of other triangles.
        others_faces: [T, 3] their indices.
        map_px: width and height of a map.
        tolerance: by which a point may lie behind the middle of the mesh.
        contact: by which it may lie behind another triangle.
        max_depth_in: largest depth behind the surface.
        template_m: template metres of a radius.
    """

    frames: np.ndarray
    distance: np.ndarray
    vertices: np.ndarray
    faces: np.ndarray
    others: np.ndarray
    others_faces: np.ndarray
    map_px: int
    tolerance: np.float32
    contact: np.float32
    max_depth_in: np.float32
    template_m: np.float32


class TracedSamples(NamedTuple):
    """What traced rays are written to: t [R, N] m, dt [R] m, is_stopped [R], face [R, N], barycentric, height [R, N] m.

    `barycentric` is [R, N, 3]; heights are metres of the world.
    """

    t: np.ndarray
    dt: np.ndarray
    is_stopped: np.ndarray
    face: np.ndarray
    barycentric: np.ndarray
    height: np.ndarray


class PointArrays(NamedTuple):
    """As `light.lighting.SurfacePoints`: position [R, 3] m, and unit vectors [R, 3] (numba allows no name `view`)."""

    position: np.ndarray
    normal: np.ndarray
    relief_normal: np.ndarray
    view_direction: np.ndarray


class SkyArrays(NamedTuple):
    """K directions of the sky: unit [K, 3], flux [K, 3], brightness [K], share [K] of the sphere; shadows [K, R]."""

    towards: np.ndarray
    flux: np.ndarray
    brightness: np.ndarray
    share: np.ndarray
    lit: np.ndarray
    depth_in_m: np.ndarray


class LampArrays(NamedTuple):
    """As `light.lamp_samples.LampSamples`, and the shadows [K, R] of each sample at R points."""

    lamp: np.ndarray
    position: np.ndarray
    is_sun: np.ndarray
    axis: np.ndarray
    is_area: np.ndarray
    share: np.ndarray
    tan_spread: np.ndarray
    spread_share: np.ndarray
    cos_cone: np.ndarray
    cone_edge: np.ndarray
    shadow: np.ndarray
    rgb: np.ndarray
    lit: np.ndarray
    depth_in_m: np.ndarray


class FeatureArrays(NamedTuple):
    """As `light.lighting.LightFeatures` at R points; zero at the start."""

    lamp_vectors: np.ndarray
    sky_vectors: np.ndarray
    sky_seen: np.ndarray
    scattered: np.ndarray


class ProbeArrays(NamedTuple):
    """P discs of skin: position and normal [3, P], area [P], and the radiance [3, P] that they shed."""

    position: np.ndarray
    normal: np.ndarray
    area_m2: np.ndarray
    shed: np.ndarray


class PatchArrays(NamedTuple):
    """P patches around a hand, as seen from R points.

    Attributes:
        position: [3, P] m, world.
        normal: [3, P].
        area_m2: [P].
        shed: [3, P] radiance.
        open_to: [R, K] share of each of the sky's directions that the hand alone leaves open at each point.
        sky_cell: [cells * cells, N] the sky's directions nearest to each cell of directions.
        sky_weight: of these.
        cells: along a side.
    """

    position: np.ndarray
    normal: np.ndarray
    area_m2: np.ndarray
    shed: np.ndarray
    open_to: np.ndarray
    sky_cell: np.ndarray
    sky_weight: np.ndarray
    cells: int


class NearArrays(NamedTuple):
    """As `light.surrounding_light.NearLight` at R points."""

    sky_vectors: np.ndarray
    near_gloss: np.ndarray
    scattered: np.ndarray


class Lobes(NamedTuple):
    """Constants of `light.lighting` and `light.gloss`.

    SCATTER_M, WRAP, SCATTERED_SCALE and alpha (squared ROUGHNESS) [2], the angle of a sky cell, the squared INDEX, and
    BELOW_HORIZON; `nail_alpha` is the first lobe's on nails.
    """

    scatter_m: np.ndarray
    wrap: np.ndarray
    scattered_scale: np.ndarray
    alpha: np.ndarray
    nail_alpha: np.float32
    sky_cell_rad: np.float32
    squared_index: np.float32
    below_horizon: np.float32


class MirrorArrays(NamedTuple):
    """As `light.mirrored_sky.MirroredSky`, the map's `SIDE`, and `LEAST_ROUGHNESS` of `light.round_lobes`."""

    radiance: np.ndarray
    lobes: np.ndarray
    side: int
    least_roughness: np.float32


class RelitImage(NamedTuple):
    """P pixels of a full-size image and the light's features at its R low-resolution rays.

    Attributes:
        pixel: [P] row * width + column, in the full-size image.
        coefficients: [P, 14].
        normal: [P, 3].
        surface_normal: [P, 3].
        blurred_normal: [P, 3].
        alpha_squared: [P].
        view_direction: [P, 3].
        share: [P, 4] of the four low-resolution pixels around each.
        light: [R, C] features: lamp vectors, sky vectors, the sky's seen shares, gloss of what is near, scattered
            light, `arriving` and `reflected`.
        row: [h * w] which ray a low-resolution pixel has, -1 for none.
        width: of the low-resolution image.
        lamp_rgb: [L, 3].
        lamp_radius_rad: [L].
        nail: [P].
        sharpness: [3].
    """

    pixel: np.ndarray
    coefficients: np.ndarray
    normal: np.ndarray
    surface_normal: np.ndarray
    blurred_normal: np.ndarray
    alpha_squared: np.ndarray
    view_direction: np.ndarray
    share: np.ndarray
    light: np.ndarray
    row: np.ndarray
    width: int
    lamp_rgb: np.ndarray
    lamp_radius_rad: np.ndarray
    nail: np.ndarray
    sharpness: np.ndarray


class EnlargedArrays(NamedTuple):
    """What enlarged pixels are written to: coefficients [P, 14] and normal [P, 3] of P pixels, alpha [H * W] of all."""

    coefficients: np.ndarray
    normal: np.ndarray
    alpha: np.ndarray


class SeenFaces(NamedTuple):
    """What P pixels see of a surface.

    Attributes:
        face: [P] the first front face in the centre, -1 for none.
        depth: [P] of it, m.
        coverage: [P].
        camera: [3] its centre, m.
    """

    face: np.ndarray
    depth: np.ndarray
    coverage: np.ndarray
    camera: np.ndarray


class RaysOnSurface(NamedTuple):
    """Where R rays meet a surface, in an image of P pixels.

    Attributes:
        pixel: [R] of each ray.
        row: [P] which ray a pixel has, -1 for none.
        width: of the image, px.
        position: [R, 3] m.
        normal: [R, 3].
        off_plane_m: at which distance from the tangent plane rays are of another surface.
    """

    pixel: np.ndarray
    row: np.ndarray
    width: int
    position: np.ndarray
    normal: np.ndarray
    off_plane_m: np.float32


class FinerRows(NamedTuple):
    """One level of subdivision: start [N + 1] of each row's entries, column [K] and weight [K] of these."""

    start: np.ndarray
    column: np.ndarray
    weight: np.ndarray


class PartMarks(NamedTuple):
    """Which of P pixels show two parts of a surface of M faces (`surface.part_edges`).

    Attributes:
        between: [P] a depth between both parts, m; 0: depths do not tell any apart.
        part: [P] a bone of one of two parts; -1: bones do not tell any apart.
        bone_of_face: [M].
        apart: [B, B] whether two bones are of two parts.
    """

    between: np.ndarray
    part: np.ndarray
    bone_of_face: np.ndarray
    apart: np.ndarray


class EdgeSamples(NamedTuple):
    """What samples of the S pixels of P that show two parts show.

    Attributes:
        slot: [P] of each pixel among the S; -1 for none.
        depth: [S, 16] m; infinite beside the surface.
        face: [S, 16] -1 beside it.
    """

    slot: np.ndarray
    depth: np.ndarray
    face: np.ndarray


class PosedSurface(NamedTuple):
    """A posed fine surface: N vertices, M faces.

    Attributes:
        vertices: [N, 3] m.
        normals: [N, 3] unit.
        faces: [M, 3].
        corner_uv: [M, 3, 2].
        flex: [N] bend of the skin.
    """

    vertices: np.ndarray
    normals: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray
    flex: np.ndarray


class DetailTable(NamedTuple):
    """A pyramid of maps.

    Attributes:
        table: [T, 12] int8.
        first: the first row of each level.
        resolution: of the finest level.
    """

    table: np.ndarray
    first: np.ndarray
    resolution: int


class DetailConstants(NamedTuple):
    """Constants of `surface.skin_detail`.

    Attributes:
        least_alpha: of what is divided by it.
        texels: of the finest level in a pixel's width at a depth of 1 m.
        texel_m: side of one of these.
        least_cosine: of face and view.
        one_tap_more: as `ONE_TAP_MORE`.
        sharper: as `SHARPER`.
        blurred_level: of the maps, as red light shows them.
        flattened: what bending takes of dorsal folds.
        deepened_from: how much of palmar creases shows.
        deepened_by: what bending adds.
        bump: of a stored step of a slope, m.
        shade: what a stored step of shades and nails is worth.
        gloss: of squared alphas.
        bump_share: as `BUMP`.
        most_taps: as `MOST_TAPS`.
        pigment_colour: [3].
        fold_log_albedo: [3].
    """

    least_alpha: np.float32
    texels: np.float32
    texel_m: np.float32
    least_cosine: np.float32
    one_tap_more: np.float32
    sharper: np.float32
    blurred_level: np.float32
    flattened: np.float32
    deepened_from: np.float32
    deepened_by: np.float32
    bump: np.float32
    shade: np.float32
    gloss: np.float32
    bump_share: np.float32
    most_taps: int
    pigment_colour: np.ndarray
    fold_log_albedo: np.ndarray


class DetailedArrays(NamedTuple):
    """P pixels, changed in place: all but the first two.

    Attributes:
        pixel: [P].
        view_direction: [P, 3].
        coefficients: [P, 14].
        normal: [P, 3].
        surface_normal: [P, 3].
        blurred_normal: [P, 3].
        alpha_squared: [P].
        nail: [P].
        alpha: of all pixels of the image.
    """

    pixel: np.ndarray
    view_direction: np.ndarray
    coefficients: np.ndarray
    normal: np.ndarray
    surface_normal: np.ndarray
    blurred_normal: np.ndarray
    alpha_squared: np.ndarray
    nail: np.ndarray
    alpha: np.ndarray
