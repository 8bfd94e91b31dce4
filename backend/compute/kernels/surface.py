"""Posed surfaces: the hand's mesh, the finer one on it, and points on either.

As `hand.lbs.skin_motion`, `geometry.mesh.posed_mesh`, `geometry.local_rotation.local_rotations`,
`surface.detail_mesh.detail_mesh`, `light.indirect_diffuse.MeshPoints.of`, and normals of `surface.ray_hits.ray_hits`.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...geometry.tolerances import NEAR_M
from .compiled import compiled, compiled_loosely
from .compiled import compiled_part as part

_0, _1, _TINY, _NO_AREA, _SMALL_SQUARED = (np.float32(value) for value in (0, 1, 1e-12, 1e-20, 1e-6))
_NEAR_M, _FAR = np.float32(NEAR_M), np.float32(3e38)
_HALF, _6TH, _24TH = (np.float32(value) for value in (0.5, 1 / 6, 1 / 24))


class FinerRows(NamedTuple):
    """One level of subdivision: start [N + 1] of each row's entries, column [K] and weight [K] of these."""

    start: np.ndarray
    column: np.ndarray
    weight: np.ndarray


@compiled
def rotate(axis_angle, rotation):
    """Fill rotation [3, 3] as `geometry.torch_rotation.axis_angle_to_matrix`."""
    x, y, z = axis_angle[0], axis_angle[1], axis_angle[2]
    squared = x * x + y * y + z * z
    sine, cosine = _1 - squared * _6TH, _HALF - squared * _24TH
    if squared >= _SMALL_SQUARED:
        angle = np.sqrt(squared)
        sine, cosine = np.sin(angle) / angle, (_1 - np.cos(angle)) / squared
    rotation[0, 0], rotation[1, 1], rotation[2, 2] = (
        _1 - cosine * (y * y + z * z),
        _1 - cosine * (x * x + z * z),
        _1 - cosine * (x * x + y * y),
    )
    rotation[0, 1], rotation[1, 0] = cosine * x * y - sine * z, cosine * x * y + sine * z
    rotation[0, 2], rotation[2, 0] = cosine * x * z + sine * y, cosine * x * z - sine * y
    rotation[1, 2], rotation[2, 1] = cosine * y * z - sine * x, cosine * y * z + sine * x


@compiled
def joint_transforms(rotations, rest_joints, parents, transforms):
    """Fill transforms [16, 3, 4] as `hand.lbs.joint_transforms`; parents come before their children."""
    for joint in range(len(parents)):
        parent = parents[joint]
        for row in range(3):
            for column in range(3):
                turned = rotations[joint, row, column]
                if parent >= 0:
                    turned = _0
                    for k in range(3):
                        turned += transforms[parent, row, k] * rotations[joint, k, column]
                transforms[joint, row, column] = turned
        for row in range(3):
            # Where the joint comes to lie, less where its own rotation would take it.
            place = rest_joints[joint, row]
            if parent >= 0:
                place = transforms[parent, row, 3]
                for k in range(3):
                    place += transforms[parent, row, k] * rest_joints[joint, k]
            for k in range(3):
                place -= transforms[joint, row, k] * rest_joints[joint, k]
            transforms[joint, row, 3] = place


@compiled_loosely
def add_offsets(directions, features, values):
    """Add to values [N] the features' sum of `directions` [N, K]."""
    for row in range(len(values)):
        total = _0
        for k in range(np.uintp(len(features))):
            total += features[k] * directions[row, k]
        values[row] += total


@compiled
def blend_transforms(transforms, weights, of_forearm, arm_weights, shift, blended):
    """Fill blended [V, 3, 4]: each vertex's own transform to the world."""
    for vertex in range(len(blended)):
        for row in range(3):
            for column in range(4):
                blended[vertex, row, column] = arm_weights[vertex] * of_forearm[row, column]
            blended[vertex, row, 3] += shift[row]
        for joint in range(weights.shape[1]):
            weight = weights[vertex, joint]
            if weight != _0:
                for row in range(3):
                    for column in range(4):
                        blended[vertex, row, column] += weight * transforms[joint, row, column]


@compiled
def mesh_normals(vertices, faces, edges, normals):
    """Fill the unit normals [V, 3] as `geometry.mesh.vertex_normals`; returns the mean length of the edges, m."""
    normals[:] = _0
    for face in range(len(faces)):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        x, y, z = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        for corner in range(3):
            vertex = faces[face, corner]
            normals[vertex, 0] += x
            normals[vertex, 1] += y
            normals[vertex, 2] += z
    for vertex in range(len(normals)):
        x, y, z = normals[vertex, 0], normals[vertex, 1], normals[vertex, 2]
        length = max(np.sqrt(x * x + y * y + z * z), _TINY)
        normals[vertex, 0], normals[vertex, 1], normals[vertex, 2] = x / length, y / length, z / length
    total = 0.0
    for edge in range(len(edges)):
        a, b = edges[edge, 0], edges[edge, 1]
        x, y, z = vertices[a, 0] - vertices[b, 0], vertices[a, 1] - vertices[b, 1], vertices[a, 2] - vertices[b, 2]
        total += np.sqrt(x * x + y * y + z * z)
    return total / len(edges)


@compiled
def hand_extent(vertices, edges, world2cam, K, shell_m, edge_length_m, is_orthographic, out):
    """Fill out [9] as `image.crop.HandExtent`: scale, centre, radius, first, last; returns whether any is before it."""
    length = 0.0
    for edge in range(len(edges)):
        a, b = edges[edge, 0], edges[edge, 1]
        x, y, z = vertices[a, 0] - vertices[b, 0], vertices[a, 1] - vertices[b, 1], vertices[a, 2] - vertices[b, 2]
        length += np.sqrt(x * x + y * y + z * z)
    scale = np.float32(length / len(edges)) / edge_length_m
    cx, cy, cz = 0.0, 0.0, 0.0
    for vertex in range(len(vertices)):
        cx, cy, cz = cx + vertices[vertex, 0], cy + vertices[vertex, 1], cz + vertices[vertex, 2]
    cx, cy, cz = np.float32(cx / len(vertices)), np.float32(cy / len(vertices)), np.float32(cz / len(vertices))
    reach = max(abs(K[0, 0]), abs(K[1, 1])) * shell_m * scale
    far, is_before = _0, False
    left, top, right, bottom = _FAR, _FAR, -_FAR, -_FAR
    for vertex in range(len(vertices)):
        px, py, pz = vertices[vertex, 0], vertices[vertex, 1], vertices[vertex, 2]
        x, y, z = px - cx, py - cy, pz - cz
        far = max(far, x * x + y * y + z * z)
        x = px * world2cam[0, 0] + py * world2cam[0, 1] + pz * world2cam[0, 2] + world2cam[0, 3]
        y = px * world2cam[1, 0] + py * world2cam[1, 1] + pz * world2cam[1, 2] + world2cam[1, 3]
        depth = px * world2cam[2, 0] + py * world2cam[2, 1] + pz * world2cam[2, 2] + world2cam[2, 3]
        if depth > _NEAR_M:
            is_before = True
            along = _1 if is_orthographic else depth
            column = (K[0, 0] * x + K[0, 1] * y + K[0, 2] * along) / along
            row, around = (K[1, 0] * x + K[1, 1] * y + K[1, 2] * along) / along, reach / along
            left, top = min(left, column - around), min(top, row - around)
            right, bottom = max(right, column + around), max(bottom, row + around)
    out[0], out[1], out[2], out[3], out[4] = scale, cx, cy, cz, np.sqrt(far)
    out[5], out[6], out[7], out[8] = left, top, right, bottom
    return is_before


@compiled
def surface_rotations(vertices, normals, neighbours, weights, template, rotations):
    """Fill rotations [V, 3, 3] as `local_rotations`."""
    frame = np.empty((3, 3), np.float32)
    for vertex in range(len(rotations)):
        normal = normals[vertex]
        x, y, z = _0, _0, _0
        for k in range(neighbours.shape[1]):
            other, weight = neighbours[vertex, k], weights[vertex, k]
            x += weight * (vertices[other, 0] - vertices[vertex, 0])
            y += weight * (vertices[other, 1] - vertices[vertex, 1])
            z += weight * (vertices[other, 2] - vertices[vertex, 2])
        _fill_frame(x, y, z, normal, frame)
        for row in range(3):
            for column in range(3):
                turned = _0
                for k in range(3):
                    turned += frame[k, row] * template[vertex, k, column]
                rotations[vertex, row, column] = turned


@part
def _fill_frame(x, y, z, normal, frame):
    """Fill rows tangent, bitangent and normal; (x, y, z) is the tangent before it is made perpendicular and unit."""
    along = x * normal[0] + y * normal[1] + z * normal[2]
    x, y, z = x - along * normal[0], y - along * normal[1], z - along * normal[2]
    length = max(np.sqrt(x * x + y * y + z * z), _TINY)
    x, y, z = x / length, y / length, z / length
    frame[0, 0], frame[0, 1], frame[0, 2] = x, y, z
    frame[1, 0] = normal[1] * z - normal[2] * y
    frame[1, 1] = normal[2] * x - normal[0] * z
    frame[1, 2] = normal[0] * y - normal[1] * x
    frame[2, 0], frame[2, 1], frame[2, 2] = normal[0], normal[1], normal[2]


COLUMNS = 16
"""Of a field: position at rest 3, transform 12 row by row, bend of the skin."""


@compiled
def finer_field(level, values, first, last, finer):
    """Fill rows [first, last) of a finer field [N, 16] from a field [V, 16]; `level` is a `FinerRows`."""
    for row in range(first, last):
        for k in range(COLUMNS):
            finer[row, k] = _0
        for entry in range(level.start[row], level.start[row + 1]):
            column, weight = level.column[entry], level.weight[entry]
            for k in range(COLUMNS):
                finer[row, k] += weight * values[column, k]


@compiled
def fine_vertices(values, offset_m, normals, height_m, first, last, vertices):
    """Fill vertices [first, last) from their field, their offsets and what rises along their normals at rest."""
    for row in range(first, last):
        x = values[row, 0] + offset_m[row, 0] + height_m[row] * normals[row, 0]
        y = values[row, 1] + offset_m[row, 1] + height_m[row] * normals[row, 1]
        z = values[row, 2] + offset_m[row, 2] + height_m[row] * normals[row, 2]
        for k in range(3):
            at = 3 + 4 * k
            turned = x * values[row, at] + y * values[row, at + 1] + z * values[row, at + 2]
            vertices[row, k] = turned + values[row, at + 3]


@compiled
def face_normals(vertices, faces, first, last, normals):
    """Fill the normals of faces [first, last), as long as twice their area."""
    for face in range(first, last):
        a, b, c = faces[face, 0], faces[face, 1], faces[face, 2]
        ux, uy, uz = vertices[b, 0] - vertices[a, 0], vertices[b, 1] - vertices[a, 1], vertices[b, 2] - vertices[a, 2]
        vx, vy, vz = vertices[c, 0] - vertices[a, 0], vertices[c, 1] - vertices[a, 1], vertices[c, 2] - vertices[a, 2]
        normals[face, 0] = uy * vz - uz * vy
        normals[face, 1] = uz * vx - ux * vz
        normals[face, 2] = ux * vy - uy * vx


@compiled
def vertex_normals(of_faces, start, around, first, last, normals):
    """Fill the unit normals of vertices [first, last) from those of the faces around each."""
    for row in range(first, last):
        x, y, z = _0, _0, _0
        for entry in range(start[row], start[row + 1]):
            face = around[entry]
            x += of_faces[face, 0]
            y += of_faces[face, 1]
            z += of_faces[face, 2]
        length = max(np.sqrt(x * x + y * y + z * z), _TINY)
        normals[row, 0], normals[row, 1], normals[row, 2] = x / length, y / length, z / length


@compiled
def mesh_points(vertices, faces, face, position, first, last, vertex, weight):
    """Fill vertex [R, 3] and weight [R, 3] of points [first, last) at position [R, 3]; face [R], -1 for none."""
    for index in range(first, last):
        row, of_face = np.uintp(index), np.uintp(max(face[index], 0))
        a, b, c = faces[of_face, 0], faces[of_face, 1], faces[of_face, 2]
        vertex[row, 0], vertex[row, 1], vertex[row, 2] = a, b, c
        nx, ny, nz = _cross(vertices, a, b, vertices[c, 0], vertices[c, 1], vertices[c, 2])
        x, y, z = position[row, 0], position[row, 1], position[row, 2]
        of_a = _area(vertices, b, c, x, y, z, nx, ny, nz)
        of_b = _area(vertices, c, a, x, y, z, nx, ny, nz)
        of_c = _area(vertices, a, b, x, y, z, nx, ny, nz)
        total = max(of_a + of_b + of_c, _NO_AREA)
        is_beside = face[index] < 0
        weight[row, 0] = _0 if is_beside else of_a / total
        weight[row, 1] = _0 if is_beside else of_b / total
        weight[row, 2] = _0 if is_beside else of_c / total


@part
def _area(vertices, start, end, x, y, z, nx, ny, nz):
    """Compute the area that the triangle of an edge and a point spans along a normal, at least 0."""
    cx, cy, cz = _cross(vertices, start, end, x, y, z)
    return max(cx * nx + cy * ny + cz * nz, _0)


@part
def _cross(vertices, start, end, x, y, z):
    """Compute (end - start) x (point - start)."""
    ux, uy, uz = vertices[start, 0], vertices[start, 1], vertices[start, 2]
    vx, vy, vz = vertices[end, 0] - ux, vertices[end, 1] - uy, vertices[end, 2] - uz
    x, y, z = x - ux, y - uy, z - uz
    return vy * z - vz * y, vz * x - vx * z, vx * y - vy * x


@compiled
def fill_normals(mesh, normals, face, pixel, width, first, last, out):
    """Fill out [R, 3] with the unit normals of faces [R] in pixels' centres, for rays [first, last); 0 for face -1.

    `normals` [N, 3] are those of the vertices of `mesh` (`ProjectedMesh`).
    """
    for ray in range(first, last):
        out[ray, 0], out[ray, 1], out[ray, 2] = _0, _0, _0
        if face[ray] < 0:
            continue
        a, b, c = mesh.faces[face[ray], 0], mesh.faces[face[ray], 1], mesh.faces[face[ray], 2]
        x, y = np.float32(pixel[ray] % width) + _HALF, np.float32(pixel[ray] // width) + _HALF
        ax, ay = mesh.positions_px[a, 0], mesh.positions_px[a, 1]
        bx, by = mesh.positions_px[b, 0], mesh.positions_px[b, 1]
        cx, cy = mesh.positions_px[c, 0], mesh.positions_px[c, 1]
        wa = (cx - bx) * (y - by) - (cy - by) * (x - bx)
        wb = (ax - cx) * (y - cy) - (ay - cy) * (x - cx)
        wc = (bx - ax) * (y - ay) - (by - ay) * (x - ax)
        if not mesh.is_orthographic:
            wa, wb, wc = wa / mesh.depth[a], wb / mesh.depth[b], wc / mesh.depth[c]
        squared, weight = _0, _1 / (wa + wb + wc)
        for axis in range(3):
            value = weight * (wa * normals[a, axis] + wb * normals[b, axis] + wc * normals[c, axis])
            out[ray, axis] = value
            squared += value * value
        length = max(np.sqrt(squared), _TINY)
        for axis in range(3):
            out[ray, axis] /= length
