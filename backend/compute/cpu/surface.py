"""Posed surfaces by kernels: as `hand.lbs.skin_motion`, `geometry.mesh`, `geometry.local_rotation` and `surface`.

The hand's own mesh is small: one thread is faster than two.
"""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...field.rays import CameraTensors, origin_axes
from ...geometry.local_rotation import LocalFrames
from ...geometry.mesh import PosedMesh, Topology
from ...hand.lbs import SkinMotion, SkinTensors
from ...image.crop import HandExtent
from ...image.shading import MIN_ALPHA, ShadingInputs
from ...light.lighting import BumpMapping
from ...records.shot import HandPose
from ...surface.albedo_ratio import RATIO_STEP
from ...surface.detail_maps import BUMP, GLOSS_STEP, SHADE_STEP, SLOPE_STEP_MM, DetailMaps
from ...surface.detail_maps_file import DEEPENED_BY, DEEPENED_FROM, FLATTENED
from ...surface.detail_mesh import SAMPLES, DetailMesh, DetailTemplate, PixelSurface, SubdivisionLevel
from ...surface.edge_antialiasing import SPREAD, EdgePixels, part_steps
from ...surface.ray_hits import RayHits
from ...surface.shading_detail import FOLD_LOG_ALBEDO, LEAST_COSINE, MOST_TAPS, ONE_TAP_MORE, SHARPER
from ..kernels.detail import (
    DetailConstants,
    DetailedArrays,
    DetailTable,
    PosedSurface,
    RatioTable,
    VisibleFaces,
    add_skin,
)
from ..kernels.edges import (
    EdgeMask,
    EdgeSamples,
    blend_parts,
    depth_at_rim,
    edge_shares,
    find_part_edges,
    mark_outline,
    pixel_squares,
    sample_faces,
    spread_coverage,
)
from ..kernels.surface import (
    FinerRows,
    add_offsets,
    blend_transforms,
    face_normals,
    fill_normals,
    fine_vertices,
    finer_field,
    joint_transforms,
    mesh_normals,
    rotate,
    surface_rotations,
    vertex_normals,
)
from ..kernels.surface import hand_extent as measure_hand
from ..reference import ReferenceBackend
from .arrays import as_arrays
from .rays import find_fronts, projected_mesh
from .threads import in_parallel


def skin_motion(skin: SkinTensors, pose: HandPose) -> SkinMotion:
    """Compute how a pose moves the vertices into the world; `skin` is that of its side."""
    theta, beta, transl, forearm = (
        np.ascontiguousarray(values, np.float32) for values in (pose.theta, pose.beta, pose.transl, pose.forearm)
    )
    rest = skin.v_template.numpy().copy()
    _add(skin.shapedirs, beta, rest)
    rest_joints = (skin.J_regressor @ torch.as_tensor(rest)).numpy()
    rotations, transforms = np.empty((len(theta), 3, 3), np.float32), np.empty((len(theta), 3, 4), np.float32)
    for axis_angle, rotation in zip(theta, rotations, strict=True):
        rotate(axis_angle, rotation)
    joint_transforms(rotations, rest_joints, np.array(skin.parents), transforms)
    identity = np.eye(3, dtype=np.float32)
    _add(skin.posedirs, (rotations[1:] - identity).ravel(), rest)
    of_forearm = _of_forearm(forearm, transforms[0], rest_joints[0])
    blended, weights = np.empty((len(rest), 3, 4), np.float32), as_arrays(skin.lbs_weights, skin.arm_weights)
    blend_transforms(transforms, weights[0], of_forearm, weights[1], transl, blended)
    return SkinMotion(torch.as_tensor(rest), torch.as_tensor(blended))


def posed_mesh(topology: Topology, vertices: Float[Tensor, "V 3"]) -> PosedMesh:
    """Compute normals and scale of posed vertices."""
    normals = torch.empty_like(vertices, memory_format=torch.contiguous_format)
    length_m = mesh_normals(*as_arrays(vertices, topology.faces, topology.edges, normals))
    return PosedMesh(vertices, normals, length_m / topology.edge_length_m)


def hand_extent(
    topology: Topology, vertices: Float[Tensor, "V 3"], camera: CameraTensors, shell_m: float
) -> HandExtent:
    """Measure a posed hand, as `image.crop.hand_extent`."""
    found, of_mesh = np.empty(9, np.float32), as_arrays(vertices, topology.edges, camera.world2cam, camera.K)
    numbers = np.float32(shell_m), np.float32(topology.edge_length_m), camera.is_orthographic
    is_before = measure_hand(*of_mesh, *numbers, found)
    first = found[5:7] if is_before else None
    return HandExtent(float(found[0]), found[1:4], float(found[4]), first, found[7:9])


def local_rotations(
    vertices: Float[Tensor, "V 3"], normals: Float[Tensor, "V 3"], frames: LocalFrames
) -> Float[Tensor, "V 3 3"]:
    """Compute matrices from the canonical template's directions to the world's."""
    rotations = torch.empty(len(vertices), 3, 3)
    surface_rotations(*as_arrays(vertices, normals, *frames, rotations))
    return rotations


def _add(directions: Float[Tensor, "V 3 K"], features: np.ndarray, vertices: np.ndarray) -> None:
    """Add the features' sum of directions to vertices [V, 3]."""
    rows, values = directions.flatten(0, 1).numpy(), vertices.reshape(-1)
    if features.any():
        add_offsets(rows, features, values)


def _of_forearm(forearm: np.ndarray, wrist: np.ndarray, rest_wrist: np.ndarray) -> np.ndarray:
    """Compute [3, 4] as `hand.lbs.forearm_offsets`, for a vertex that follows the forearm alone."""
    turned = np.empty((3, 3), np.float32)
    rotate(forearm, turned)
    by = turned - np.eye(3, dtype=np.float32)
    return wrist[:, :3] @ np.column_stack([by, -(by @ rest_wrist)])


_SAMPLES, _SPREAD = np.array(SAMPLES, np.float32).T.copy(), np.array(SPREAD, np.float32)


def detail_mesh(
    template: DetailTemplate,
    motion: SkinMotion,
    height_m: Float[Tensor, " N"],
    flex: Float[Tensor, " V"],
    scale: Float[Tensor, ""],
) -> DetailMesh:
    """Compute the detail mesh, as `surface.detail_mesh.detail_mesh`."""
    count = len(template.offset_m)
    values = torch.cat([motion.rest, motion.transforms.flatten(1), flex[:, None]], 1).numpy()
    for level in template.levels:
        values = _finer(level, values)
    vertices, normals, of_faces = torch.empty(count, 3), torch.empty(count, 3), torch.empty(len(template.faces), 3)
    placed, unit, long, faces = as_arrays(vertices, normals, of_faces, template.faces)
    at_rest = as_arrays(template.offset_m, template.normals, height_m)
    in_parallel(lambda first, last: fine_vertices(values, *at_rest, first, last, placed), count)
    in_parallel(lambda first, last: face_normals(placed, faces, first, last, long), len(faces))
    start, around = as_arrays(*template.around)
    in_parallel(lambda first, last: vertex_normals(long, start, around, first, last, unit), count)
    bend = torch.as_tensor(values[:, -1])
    shared = template.bones, template.coarse_faces
    return DetailMesh(vertices, normals, template.faces, template.corner_uv, bend, scale, *shared)


def _finer(level: SubdivisionLevel, values: np.ndarray) -> np.ndarray:
    rows = FinerRows(*as_arrays(level.start, level.column, level.weight))
    finer = np.empty((len(rows.start) - 1, values.shape[1]), np.float32)
    in_parallel(lambda first, last: finer_field(rows, values, first, last, finer), len(finer))
    return finer


def visible_surface(mesh: DetailMesh, camera: CameraTensors) -> PixelSurface:
    """Find what pixels show, as `surface.detail_mesh.visible_surface`."""
    width, height = camera.size_px
    projected, pixels = projected_mesh(camera, mesh.vertices, mesh.faces), width * height
    nearest, face_at, rows = find_fronts(projected, camera.size_px)
    on_outline, bits = np.empty(pixels, np.bool_), np.zeros(pixels, np.uint16)
    covered, coverage, deep = np.empty((3, pixels), np.float32)
    bone_of_face, apart = as_arrays(*mesh.bones)
    marks = EdgeMask(np.empty(pixels, np.float32), np.empty(pixels, np.int8), bone_of_face, apart)
    step_m, step_per_m = (np.float32(step) for step in part_steps(camera, mesh.scale))

    def mark_rows(first: int, last: int) -> None:
        mark_outline(face_at, width, height, first, last, on_outline)
        find_part_edges(nearest, face_at, width, height, step_m, step_per_m, first, last, marks)

    def spread_rows(first: int, last: int) -> None:
        spread_coverage(covered, on_outline, _SPREAD, width, height, first, last, coverage)
        depth_at_rim(nearest, coverage, width, height, first, last, deep)

    in_parallel(mark_rows, height)
    pixel, slot = np.flatnonzero((marks.between > 0) | (marks.part >= 0)), np.full(pixels, -1, np.int32)
    slot[pixel] = np.arange(len(pixel))
    shape = len(pixel), len(SAMPLES)
    samples = EdgeSamples(slot, np.full(shape, np.inf, np.float32), np.full(shape, -1, np.int32))

    def sample_rows(first: int, last: int) -> None:
        sample_faces(projected, rows, _SAMPLES, width, first, last, on_outline, bits, samples)
        pixel_squares(face_at, on_outline, bits, width * first, width * last, covered)

    for run in (sample_rows, spread_rows):
        in_parallel(run, height)
    share, shows_first = np.empty(len(pixel), np.float32), np.empty((9, len(pixel)), np.bool_)
    seen = nearest, face_at, width, height
    in_parallel(
        lambda first, last: edge_shares(pixel, seen, marks, samples, _SPREAD, first, last, share, shows_first),
        len(pixel),
    )
    edges = EdgePixels(*(torch.as_tensor(values) for values in (pixel, shows_first, share)))
    return PixelSurface(torch.as_tensor(face_at), torch.as_tensor(deep), torch.as_tensor(coverage), edges)


def ray_hits(mesh: DetailMesh, camera: CameraTensors, pixel: Int[Tensor, " R"]) -> RayHits:
    """Find where rays meet the surface, as `surface.ray_hits.ray_hits`."""
    projected = projected_mesh(camera, mesh.vertices, mesh.faces)
    fronts = find_fronts(projected, camera.size_px)
    at, of_vertices = as_arrays(pixel, mesh.normals)
    normal = torch.empty(len(pixel), 3)
    face, width, out = fronts.face[at], camera.size_px[0], normal.numpy()
    in_parallel(lambda first, last: fill_normals(projected, of_vertices, face, at, width, first, last, out), len(pixel))
    return RayHits(torch.as_tensor(fronts.depth[at]), normal)


def blended(
    colours: Float[Tensor, "3 H W"], alpha: Float[Tensor, "H W"], depth: Float[Tensor, "H W"], edges: EdgePixels
) -> Float[Tensor, "3 H W"]:
    """Blend both parts at edges, as `surface.edge_antialiasing.blended`."""
    pixels, mixed = colours.permute(1, 2, 0).flatten(0, 1), torch.empty(len(edges.pixel), 3)
    image, out = as_arrays(pixels, alpha.flatten(), depth.flatten()), mixed.numpy()
    what = (*image, depth.shape[1], tuple(as_arrays(*edges)), np.float32(MIN_ALPHA))
    in_parallel(lambda first, last: blend_parts(*what, first, last, out), len(mixed))
    return pixels.index_put((edges.pixel,), mixed).T.reshape(colours.shape)


def detailed_image(
    image: ShadingInputs, seen: PixelSurface, mesh: DetailMesh, camera: CameraTensors, maps: DetailMaps
) -> ShadingInputs:
    """Replace the image's skin by the avatar's surface."""
    surface = PosedSurface(*as_arrays(mesh.vertices, mesh.normals, mesh.faces, mesh.corner_uv, mesh.flex))
    of_pixels = seen.face, seen.coverage, camera.divisor(seen.depth), origin_axes(camera)
    faces = VisibleFaces._make((*as_arrays(*of_pixels), camera.size_px[0]))
    table = DetailTable(maps.table.numpy(), np.array([first for first, _ in maps.levels]), maps.resolution)
    ratio = _ratio_table(maps)
    changed = image._replace(**{name: _copy(getattr(image, name)) for name in ("coefficients", "normal", "alpha")})
    skin = _beside_the_surface(image.normal, maps)
    of_skin = skin.surface_normal, skin.blurred_normal, skin.alpha_squared, skin.nail
    filled = changed.coefficients, changed.normal, *of_skin, changed.alpha.flatten()
    arrays = DetailedArrays(*as_arrays(changed.pixel, changed.view, *filled))
    constants = _constants(mesh, camera, maps)
    in_parallel(
        lambda first, last: add_skin(faces, surface, table, ratio, constants, first, last, arrays), len(image.pixel)
    )
    return changed._replace(depth=seen.depth.reshape(image.depth.shape), skin=skin)


def _beside_the_surface(normal: Tensor, maps: DetailMaps) -> BumpMapping:
    """Make smooth bump mapping, which the kernel overwrites where the surface is seen."""
    smooth = BumpMapping.smooth(normal)
    return smooth._replace(
        surface_normal=_copy(smooth.surface_normal),
        blurred_normal=_copy(smooth.blurred_normal),
        sharpness=torch.tensor(maps.sharpness),
    )


def _ratio_table(maps: DetailMaps) -> RatioTable:
    ratio = maps.ratio
    if ratio is None:
        return RatioTable(np.zeros((0, 3), np.int8), np.zeros(1, np.int64), 1, np.float32(0), np.float32(0))
    finer_by = np.float32(np.log2(ratio.resolution / maps.resolution))
    first = np.array(ratio.first_rows)
    return RatioTable(ratio.table.numpy(), first, ratio.resolution, np.float32(RATIO_STEP), finer_by)


def _copy(values: Tensor) -> Tensor:
    return values.clone(memory_format=torch.contiguous_format)


def _constants(mesh: DetailMesh, camera: CameraTensors, maps: DetailMaps) -> DetailConstants:
    scale = float(mesh.scale)
    texel_m = scale * maps.texel_m
    texels = 1 / (float(camera.focal_px) * texel_m)
    bump = -BUMP * 1e-3 * maps.resolution * scale * SLOPE_STEP_MM
    folds = FLATTENED, DEEPENED_FROM, DEEPENED_BY
    numbers = MIN_ALPHA, texels, texel_m, LEAST_COSINE, ONE_TAP_MORE, SHARPER, maps.blurred_level, *folds, bump
    steps = SHADE_STEP, GLOSS_STEP, BUMP
    colours = (np.array(colour, np.float32) for colour in (maps.pigment_colour, FOLD_LOG_ALBEDO))
    return DetailConstants._make((*(np.float32(value) for value in (*numbers, *steps)), MOST_TAPS, *colours))


class SurfaceKernels(ReferenceBackend):
    """Posed surfaces by kernels."""

    skin_motion = staticmethod(skin_motion)
    posed_mesh = staticmethod(posed_mesh)
    hand_extent = staticmethod(hand_extent)
    local_rotations = staticmethod(local_rotations)
    detail_mesh = staticmethod(detail_mesh)
    visible_surface = staticmethod(visible_surface)
    ray_hits = staticmethod(ray_hits)
    detailed_image = staticmethod(detailed_image)
    blended = staticmethod(blended)
