"""A hand in a pose and its surface, no gradients: as `hand.lbs`, `surface.{detail_mesh, ray_hits, shading_detail}`."""

from __future__ import annotations

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from ...field.rays import CameraTensors
from ...geometry.local_rotation import LocalFrames
from ...hand.lbs import SkinMotion, SkinTensors
from ...image.shading import ShadingInputs
from ...light.lighting import BumpMapping
from ...records.shot import HandPose
from ...surface.detail_maps import BUMP, SLOPE_STEP_MM, DetailMaps
from ...surface.detail_mesh import SAMPLES, DetailMesh, DetailTemplate, PixelSurface
from ...surface.edge_antialiasing import STEP_M, STEP_PX, EdgePixels
from ...surface.ray_hits import RayHits
from ..reference import ReferenceBackend
from .image_stages import row_of
from .kernels.compiled import launch
from .kernels.detail import add_skin, fine_vertices, finer_field, vertex_normals
from .kernels.edges import blend_parts, edge_shares, mark_pixels, sample_faces, spread_coverage
from .kernels.raster import normals_at
from .kernels.skinning import joint_motions, skin_vertices
from .kernels.skinning import local_rotations as fill_rotations
from .ray_stages import projected, shown_faces, view_of

_LANES = 1
"""Threads that share the pixels of a face: the surface's are as small as these."""


MOTION = 15
"""Numbers of a vertex's motion: its place at rest, and a transform [3, 4]."""


def skin_motion(skin: SkinTensors, pose: HandPose) -> SkinMotion:
    """Compute how a pose moves the vertices into the world, as `hand.lbs.skin_motion`."""
    template = skin.v_template
    theta, beta, transl, forearm = (
        template.new_tensor(values) for values in (pose.theta, pose.beta, pose.transl, pose.forearm)
    )
    joints, vertices = len(skin.parents), len(template)
    rest_joints = skin.J_regressor @ (template + skin.shapedirs @ beta)
    features, transforms = template.new_empty(9 * (joints - 1)), template.new_empty(joints + 1, 12)
    parents = torch.tensor(skin.parents, dtype=torch.int32, device=template.device)
    launch(joint_motions, joints + 1, theta, forearm[None], rest_joints, parents, features, transforms)
    values = template.new_empty(vertices, MOTION)
    of_vertices = template, skin.shapedirs, skin.posedirs, skin.lbs_weights, skin.arm_weights
    launch(skin_vertices, vertices, *of_vertices, beta, features, transforms, transl[None], values)
    return SkinMotion(values[:, :3], values[:, 3:].unflatten(1, (3, 4)))


def local_rotations(
    vertices: Float[Tensor, "V 3"], normals: Float[Tensor, "V 3"], frames: LocalFrames
) -> Float[Tensor, "V 3 3"]:
    """Compute matrices from the canonical template's directions to the world's, orthonormal (or mirrored)."""
    rotations = vertices.new_empty(len(vertices), 3, 3)
    launch(fill_rotations, len(vertices), vertices, normals, *frames, rotations)
    return rotations


def detail_mesh(
    template: DetailTemplate,
    motion: SkinMotion,
    height_m: Float[Tensor, " N"],
    flex: Float[Tensor, " V"],
    scale: Float[Tensor, ""],
) -> DetailMesh:
    """Compute the detail mesh, as `surface.detail_mesh.detail_mesh`."""
    values = torch.cat([motion.rest, motion.transforms.flatten(1), flex[:, None]], 1)
    for level in template.levels:
        finer = values.new_empty(len(level.start) - 1, values.shape[1])
        launch(finer_field, tuple(finer.shape), level.start, level.column, level.weight, values, finer)
        values = finer
    vertices, normals = (values.new_empty(len(values), 3) for _ in range(2))
    launch(fine_vertices, len(values), values, template.offset_m, template.normals, height_m, vertices)
    launch(vertex_normals, len(values), vertices, template.faces, *template.around, normals)
    shared = template.bones, template.coarse_faces
    return DetailMesh(vertices, normals, template.faces, template.corner_uv, values[:, -1], scale, *shared)


def ray_hits(mesh: DetailMesh, camera: CameraTensors, pixel: Int[Tensor, " R"]) -> RayHits:
    """Find where rays meet the surface, as `surface.ray_hits.ray_hits`."""
    at = projected(camera, mesh.vertices, mesh.normals, mesh.vertices.new_zeros(1))
    shown = shown_faces(at, mesh.faces, camera.size_px, _LANES)
    hits = RayHits(at.new_empty(len(pixel)), at.new_empty(len(pixel), 3))
    launch(normals_at, len(pixel), at, mesh.normals, mesh.faces, shown, pixel, camera.size_px[0], *hits)
    return hits


def visible_surface(mesh: DetailMesh, camera: CameraTensors) -> PixelSurface:
    """Find what pixels show, as `surface.detail_mesh.visible_surface`."""
    (width, height), device = camera.size_px, mesh.vertices.device
    pixels = width * height
    at = projected(camera, mesh.vertices, mesh.normals, mesh.vertices.new_zeros(1))
    shown = shown_faces(at, mesh.faces, camera.size_px, _LANES)
    on_outline, between = torch.empty(pixels, dtype=torch.bool, device=device), torch.empty(pixels, device=device)
    part, bits = (
        torch.empty(pixels, dtype=torch.int32, device=device),
        torch.zeros(pixels, dtype=torch.int32, device=device),
    )
    steps = torch.stack([STEP_M * mesh.scale, STEP_PX / camera.focal_px])
    launch(mark_pixels, pixels, shown, *mesh.bones, width, height, steps, on_outline, between, part)
    pixel = ((between > 0) | (part >= 0)).nonzero()[:, 0]
    slot, count = row_of(pixel, pixels), len(pixel)
    samples = torch.full((count * len(SAMPLES),), -1, dtype=torch.int64, device=device)
    where = at, mesh.faces, _LANES, width, height, on_outline, slot, bits, samples
    launch(sample_faces, (len(mesh.faces), _LANES), *where)
    coverage, depth, face = (
        torch.empty(pixels, device=device),
        torch.empty(pixels, device=device),
        torch.empty_like(shown),
    )
    launch(spread_coverage, pixels, shown, on_outline, bits, width, height, coverage, depth, face)
    edges = EdgePixels(pixel, torch.empty(9, count, dtype=torch.bool, device=device), torch.empty(count, device=device))
    known = shown, width, height, between, part, *mesh.bones, slot, samples
    launch(edge_shares, count, pixel, *known, *edges[1:])
    return PixelSurface(face, depth, coverage, edges)


def blended(
    colours: Float[Tensor, "3 H W"], alpha: Float[Tensor, "H W"], depth: Float[Tensor, "H W"], edges: EdgePixels
) -> Float[Tensor, "3 H W"]:
    """Blend both parts at edges, as `surface.edge_antialiasing.blended`."""
    pixels, mixed = colours.permute(1, 2, 0).flatten(0, 1), colours.new_empty(len(edges.pixel), 3)
    image = pixels, alpha.flatten(), depth.flatten(), depth.shape[1]
    launch(blend_parts, len(mixed), *image, *edges, mixed)
    return pixels.index_put((edges.pixel,), mixed).T.reshape(colours.shape)


def detailed_image(
    image: ShadingInputs, seen: PixelSurface, mesh: DetailMesh, camera: CameraTensors, maps: DetailMaps
) -> ShadingInputs:
    """Replace the image's skin by the avatar's surface."""
    copies = {name: _copy(getattr(image, name)) for name in ("coefficients", "normal", "alpha")}
    smooth = BumpMapping.smooth(image.normal)
    skin = smooth._replace(
        surface_normal=_copy(smooth.surface_normal),
        blurred_normal=_copy(smooth.blurred_normal),
        sharpness=smooth.sharpness.new_tensor(maps.sharpness),
    )
    surface = mesh.vertices, mesh.normals, mesh.faces, mesh.corner_uv, mesh.flex
    firsts = mesh.faces.new_tensor([first for first, _ in maps.levels])
    tables = maps.table, firsts, maps.resolution, *_ratio_of(maps)
    known = seen.face.long(), seen.depth, seen.coverage, view_of(camera)
    nowhere, nothing_pressed = image.normal.new_zeros(0), image.normal.new_zeros(0, 2)
    of_view = _constants(mesh, camera, maps), image.normal.new_tensor(maps.pigment_colour)
    of_blood = nowhere, image.normal.new_zeros(3), nothing_pressed
    of_skin = skin.surface_normal, skin.blurred_normal, skin.alpha_squared, skin.nail
    written = copies["coefficients"], copies["normal"], *of_skin, copies["alpha"].view(-1)
    launch(
        add_skin, len(image.pixel), *known, *surface, *tables, *of_view, *of_blood, image.pixel, image.view, *written
    )
    return image._replace(**copies, depth=seen.depth.reshape(image.depth.shape), skin=skin)


def _ratio_of(maps: DetailMaps) -> tuple[Tensor, Tensor, int]:
    """Return the table of the person's factor on albedo, the first row of each level, and its resolution."""
    if maps.ratio is None:
        return maps.table.new_zeros(0, 3), maps.table.new_zeros(1, dtype=torch.int64), 1
    firsts = torch.tensor(maps.ratio.first_rows, device=maps.table.device)
    return maps.ratio.table, firsts, maps.ratio.resolution


def _constants(mesh: DetailMesh, camera: CameraTensors, maps: DetailMaps) -> Float[Tensor, " 5"]:
    """Compute the constants of a view, as `kernels.detail` lists them."""
    texel_m = mesh.scale * maps.texel_m
    slope = mesh.scale * (-BUMP * 1e-3 * maps.resolution * SLOPE_STEP_MM)
    finer_by = 0.0 if maps.ratio is None else float(np.log2(maps.ratio.resolution / maps.resolution))
    numbers = mesh.scale.new_tensor([float(maps.blurred_level), finer_by])
    return torch.stack([1 / (camera.focal_px * texel_m), texel_m, numbers[0], slope, numbers[1]])


def _copy(values: Tensor) -> Tensor:
    return values.clone(memory_format=torch.contiguous_format)


class DetailStages(ReferenceBackend):
    """A hand in a pose, and the avatar's surface, by Warp."""

    skin_motion = staticmethod(skin_motion)
    local_rotations = staticmethod(local_rotations)
    detail_mesh = staticmethod(detail_mesh)
    ray_hits = staticmethod(ray_hits)
    visible_surface = staticmethod(visible_surface)
    blended = staticmethod(blended)
    detailed_image = staticmethod(detailed_image)
