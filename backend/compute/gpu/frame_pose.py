"""The first launches of a lit frame: the hand in its pose, its surface, and what pixels show of both."""

from __future__ import annotations

import numpy as np
import warp as wp

from .blocks import address_of, part_of, stride_of
from .frame_buffers import LitBuffers
from .frame_nearby import POINTS
from .kernels.detail import finer_field, raised_vertices, vertex_normals
from .kernels.hits import project_layers
from .kernels.raster import find_fronts, normals_at, project_vertices
from .kernels.skinning import joint_motions, mesh_surface, skin_vertices, vertex_conditions

ON_POSE_M = 1e-4
"""A mesh that is nowhere farther from that of its pose is moved by it alone."""
MOTION, FLEX = 16, 15
"""Numbers of a vertex that subdivision carries over to the surface: its place at rest, its motion, and its bend."""
_LANES = 1
"""Threads that share the pixels of a face: the surface's are as small as these."""


def add_pose(frame: LitBuffers) -> None:
    """Add the posing of the mesh and of the surface over it."""
    vertices, skin = len(frame.model.albedo), frame.model.template.skin
    joints = len(skin.parents)
    frame.new("features", wp.float32, 9 * (joints - 1))
    frame.new("transforms", wp.float32, joints + 1, 12)
    motion = frame.new("motion", wp.float32, vertices, MOTION)
    frame.new("normals", wp.vec3, vertices)
    frame.new("area_m2", wp.float32, vertices)
    frame.new("vertex_channels", wp.float32, vertices, 21)
    frame.add(joint_motions, joints + 1, "theta", "forearm", "rest_joints", "parents", "features", "transforms")
    of_vertices = "template", "shapedirs", "posedirs", "lbs_weights", "arm_weights"
    frame.add(skin_vertices, vertices, *of_vertices, "beta", "features", "transforms", "transl", motion)
    of_mesh = "vertices", "faces", "start", "around"
    frame.add(mesh_surface, vertices, *of_mesh, motion, "normals", "area_m2", "farthest_bits")
    about = "vertices", "normals", "frame_neighbours", "frame_weights", "frame_template"
    moved = "skinning", "joint_pose", "template", "mirror", "scale", on_pose_bits(), "farthest_bits", "flex"
    frame.add(vertex_conditions, vertices, *about, *moved, "vertex_channels", motion)
    _add_surface(frame, motion)


def on_pose_bits() -> int:
    """Return the bits of `ON_POSE_M`, which are in the order of lengths."""
    return int(np.float32(ON_POSE_M).view(np.int32))


def _add_surface(frame: LitBuffers, motion: wp.array) -> None:
    """Add the subdivision of the mesh and the surface's vertices, which follow the mesh's among what casts shadows."""
    vertices, fine = len(frame.model.albedo), len(frame.model.template.offset_m)
    values = motion
    for number, level in enumerate(frame.model.template.levels):
        finer = frame.new(f"motion{number}", wp.float32, len(level.start) - 1, MOTION)
        names = (f"level{number}_{name}" for name in ("start", "column", "weight"))
        frame.add(finer_field, finer.shape, *names, values, finer)
        values = finer
    casters = frame.new("casters", wp.vec3, vertices + fine)
    frame.named("fine", part_of(casters, vertices, fine))
    frame.new("fine_normals", wp.vec3, fine)
    frame.named("fine_flex", column_of(values, FLEX))
    raised = "raised_shares", "raised_start", "raised_part", "raised_m", "resting_m"
    frame.add(raised_vertices, fine, values, "offset_m", "rest_normals", *raised, "fine")
    frame.add(vertex_normals, fine, "fine", "fine_faces", "fine_start", "fine_around", "fine_normals")


def column_of(rows: wp.array, column: int) -> wp.array:
    """Return a column of rows [R, C] as an array [R], without a copy."""
    return wp.array(
        ptr=address_of(rows) + 4 * column,
        dtype=wp.float32,
        shape=(rows.shape[0],),
        strides=(stride_of(rows),),
        device=rows.device,
    )


def add_views(frame: LitBuffers) -> None:
    """Add what the pixels of both images show of the surface, and what those of rays show of the mesh."""
    (width, height), vertices = frame.shape.size_px, len(frame.model.albedo)
    fine, rays = len(frame.model.template.offset_m), frame.shape.rays
    for suffix, camera, size in (("_low", "K", 1), ("", "full_K", 2)):
        at = frame.new(f"fine_at{suffix}", wp.vec3, fine)
        frame.add(project_vertices, fine, "fine", "fine_normals", "no_lift_m", camera, "world2cam", at)
        sizes = _LANES, size * width, size * height
        faces = len(frame.model.template.faces)
        frame.add(find_fronts, (faces, _LANES), at, "fine_faces", *sizes, f"shown{suffix}")
    frame.new("hit_m", wp.float32, rays)
    frame.new("hit_normals", wp.vec3, rays)
    frame.constant("every_pixel", np.arange(rays), wp.int64)
    seen = "fine_at_low", "fine_normals", "fine_faces", "shown_low", "every_pixel"
    frame.add(normals_at, rays, *seen, width, "hit_m", "hit_normals")
    frame.new("moved", wp.vec3, vertices)
    layers = frame.new("layers", wp.vec3, 4 * vertices)
    as_rows = layers.reshape((4, vertices))
    of_patches = 2 * POINTS if frame.shape.has_patches else 0
    points = frame.new("points", wp.vec3, vertices + 2 * rays + of_patches)
    frame.named("position", part_of(points, vertices, rays))
    frame.named("on_surface", part_of(points, vertices + rays, rays))
    of_mesh = "vertices", "normals", "fine", "K", "world2cam", "scale", "lifts_m"
    frame.add(project_layers, vertices, *of_mesh, "moved", as_rows, "points", "casters")
    for number, name in ((2, "shown_mesh"), (3, "shown_outer")):
        at = part_of(layers, number * vertices, vertices)
        frame.add(
            find_fronts, (len(frame.model.topology.faces), frame.lanes), at, "faces", frame.lanes, width, height, name
        )
    for number, name in ((0, "inflated"), (1, "deflated")):
        frame.named(name, part_of(layers, number * vertices, vertices))
