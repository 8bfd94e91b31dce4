"""The views of shadow maps of a lit frame: their axes, and which maps, points and casters they have."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from ...light.lamp_samples import LampSamples
from ...light.shadow_maps import (
    CELL_MAP_PX,
    FAR,
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

_AXES, _NEXT, _AFTER = np.arange(3)[:, None], [1, 2, 0], [2, 0, 1]


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
    of_rays = lamp_views(lamps, shot.bounds)
    groups = [(at_rays, of_rays)]
    groups.append((at_surfels, of_rays if shot.at_surfels is lamps else lamp_views(shot.at_surfels, shot.bounds)))
    if last is None or sky is not last.light.sky:
        views = sky.views()
        groups += [(of_sky, (views.frames.numpy(), views.distance.numpy()))]
        groups += [(of_sky_there, groups[-1][1])] if shot.patches is not None else []
    if shot.patches is not None:
        groups.append((at_patches, lamp_views(shot.at_surfels, bounds)))
    for rows, (frames, distance) in groups:
        host["frames"][rows], host["distance"][rows] = frames, distance
    _fill_spheres(host, shot, bounds)
    if last is None or _table_of(shot) != _table_of(last):
        _fill_table(host["table"], model, shape, shot)


def lamp_views(lamps: LampSamples, bounds: Bounds) -> tuple[np.ndarray, np.ndarray]:
    """Return frames [K, 3, 3] and distances [K] of `LampSamples.views`, in a third of its time."""
    position, is_sun = lamps.position.numpy().T, lamps.is_sun.numpy()
    offset = position - bounds.centre.numpy()[:, None]
    distance = np.sqrt((offset * offset).sum(0))
    towards = np.where(is_sun, position, offset / np.maximum(distance, 1e-6))
    radii = np.where(is_sun, FAR, np.minimum(np.maximum(distance / float(bounds.radius), 1e-3), FAR))
    frames, axes = np.empty((3, 3, position.shape[1]), np.float32), np.abs(towards).argmin(0) == _AXES
    right = _crossed(axes, towards)
    right /= np.maximum(np.sqrt((right * right).sum(0)), 1e-12)
    frames[0], frames[1], frames[2] = right, _crossed(right, towards), towards
    return frames.transpose(2, 0, 1), radii


def _crossed(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Return the cross products of vectors [3, K]."""
    return one[_NEXT] * other[_AFTER] - one[_AFTER] * other[_NEXT]


def _table_of(shot: LitShot) -> tuple[bytes, int]:
    """Return what a table depends on in frames of one shape."""
    return shot.is_hard.tobytes(), 0 if shot.patches is None else len(shot.patches.points.position)


def _fill_spheres(host: HostBlock, shot: LitShot, of_patches: Bounds) -> None:
    for row, bounds in enumerate((shot.bounds, of_patches)):
        radius = float(bounds.radius)
        host["spheres"][row] = (*bounds.centre.tolist(), radius)
        host["lengths"][row] = scene_lengths(shot.scale / radius)


def _fill_table(table: np.ndarray, model: LitModel, shape: FrameShape, shot: LitShot) -> None:
    """Fill the table of `kernels.shadow`."""
    vertices = len(model.albedo)
    mesh, coarse, finest = casters_of(model)
    on_hand, on_patches, at_patches = vertices + shape.rays, vertices + 2 * shape.rays, 0
    if shot.patches is not None:
        at_patches = len(shot.patches.points.position)
    sky, rays, surfels, patch_sky, patch_lamps = shape.view_groups
    table[sky] = SKY_MAP_PX, 0, 0, vertices, 1, *mesh, 0
    table[:SKY_DIRECTIONS, int(MAP_PX)] = CELL_MAP_PX
    table[rays] = SOFT_MAP_PX, 0, on_hand, 0, 1, *coarse, 0
    hard = np.arange(rays.start, rays.stop)[shot.is_hard]
    table[hard] = LAMP_MAP_PX, 0, on_hand, 0, 1, *(finest if shape.has_fine_shadows else coarse), 0
    table[surfels] = SURFEL_MAP_PX, 0, 0, vertices, 0, *mesh, 0
    table[patch_sky] = SKY_MAP_PX, 0, on_patches, at_patches, 0, *mesh, 1
    table[patch_lamps] = LAMP_MAP_PX, 0, on_patches + POINTS, at_patches, 0, *mesh, 1
    cells = 3 * table[:, int(MAP_PX)] ** 2
    table[:, int(MAP_AT)] = cells.cumsum() - cells
