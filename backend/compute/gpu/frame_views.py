"""The views of shadow maps of a lit frame: their axes, and which maps, points and casters they have."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from ...light.shadow_maps import (
    CELL_MAP_PX,
    LAMP_MAP_PX,
    SKY_MAP_PX,
    SOFT_MAP_PX,
    SURFEL_MAP_PX,
    Bounds,
    scene_lengths,
)
from ...light.sky_samples import SKY_DIRECTIONS
from ..whole_frames import LitModel, LitShot
from .blocks import HostBlock
from .frame_nearby import POINTS
from .frame_shape import FrameShape
from .kernels.shadow import MAP_AT, MAP_PX


class CasterRange(NamedTuple):
    """What casts shadows: vertices and faces, of each the first and how many."""

    first_vertex: int
    vertices: int
    first_face: int
    faces: int


def casters_of(model: LitModel) -> tuple[CasterRange, CasterRange, CasterRange]:
    """List what casts shadows: the mesh, the surface in a quarter of its faces, and in all of them."""
    vertices, faces, fine = len(model.albedo), len(model.topology.faces), len(model.template.offset_m)
    coarse = CasterRange(vertices, model.casting_vertices, faces, model.casting_faces)
    finest = CasterRange(vertices, fine, faces + model.casting_faces, len(model.template.faces))
    return CasterRange(0, vertices, 0, faces), coarse, finest


def fill_views(host: HostBlock, model: LitModel, shape: FrameShape, shot: LitShot, last: LitShot | None) -> None:
    """Fill the views of a frame, about the hand and about nearby patches and the hand; `last` as `fill_parameters`."""
    sky, lamps = shot.light
    bounds = shot.bounds if shot.patches is None else shot.patches.points.bounds_with(torch.as_tensor(shot.vertices))
    of_sky, at_rays, at_surfels, of_sky_there, at_patches = shape.view_groups
    of_rays = lamps.views(shot.bounds)
    groups = [(at_rays, of_rays)]
    groups.append((at_surfels, of_rays if shot.at_surfels is lamps else shot.at_surfels.views(shot.bounds)))
    if last is None or sky is not last.light.sky:
        groups += [(of_sky, sky.views())]
        groups += [(of_sky_there, groups[-1][1])] if shot.patches is not None else []
    if shot.patches is not None:
        groups.append((at_patches, shot.at_surfels.views(bounds)))
    for rows, views in groups:
        host["frames"][rows], host["distance"][rows] = views.frames.numpy(), views.distance.numpy()
    _fill_spheres(host, shot, bounds)
    if last is None or _table_of(shot) != _table_of(last):
        _fill_table(host["table"], model, shape, shot)


def _table_of(shot: LitShot) -> tuple[bytes, int]:
    """Return what a table depends on in frames of one shape."""
    return shot.light.lamps.is_hard.numpy().tobytes(), 0 if shot.patches is None else len(shot.patches.points.position)


def _fill_spheres(host: HostBlock, shot: LitShot, of_patches: Bounds) -> None:
    for row, bounds in enumerate((shot.bounds, of_patches)):
        radius = float(bounds.radius)
        host["spheres"][row] = (*bounds.centre.tolist(), radius)
        host["lengths"][row] = scene_lengths(shot.scale / radius)


def _fill_table(table: np.ndarray, model: LitModel, shape: FrameShape, shot: LitShot) -> None:
    """Fill the table of `kernels.shadow`."""
    vertices, lamps = len(model.albedo), shot.light.lamps
    mesh, coarse, finest = casters_of(model)
    on_hand, on_patches, at_patches = vertices + shape.rays, vertices + 2 * shape.rays, 0
    if shot.patches is not None:
        at_patches = len(shot.patches.points.position)
    sky, rays, surfels, patch_sky, patch_lamps = shape.view_groups
    table[sky] = SKY_MAP_PX, 0, 0, vertices, 1, *mesh, 0
    table[:SKY_DIRECTIONS, int(MAP_PX)] = CELL_MAP_PX
    table[rays] = SOFT_MAP_PX, 0, on_hand, 0, 1, *coarse, 0
    hard = np.arange(rays.start, rays.stop)[lamps.is_hard.numpy()]
    table[hard] = LAMP_MAP_PX, 0, on_hand, 0, 1, *(finest if shape.has_fine_shadows else coarse), 0
    table[surfels] = SURFEL_MAP_PX, 0, 0, vertices, 0, *mesh, 0
    table[patch_sky] = SKY_MAP_PX, 0, on_patches, at_patches, 0, *mesh, 1
    table[patch_lamps] = LAMP_MAP_PX, 0, on_patches + POINTS, at_patches, 0, *mesh, 1
    cells = 3 * table[:, int(MAP_PX)] ** 2
    table[:, int(MAP_AT)] = cells.cumsum() - cells
