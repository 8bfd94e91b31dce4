"""Equals `hand.lbs.skin_motion`, `geometry.mesh.posed_mesh` and `geometry.local_rotation.local_rotations`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled, compiled_loosely
from .compiled import compiled_part as part

_0, _1, _TINY, _SMALL_SQUARED = (np.float32(value) for value in (0, 1, 1e-12, 1e-6))
_HALF, _6TH, _24TH = (np.float32(value) for value in (0.5, 1 / 6, 1 / 24))


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
