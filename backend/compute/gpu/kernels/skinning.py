"""A hand in a pose: as `hand.lbs`, `geometry.mesh`, `geometry.local_rotation` and `field.conditions`."""

from __future__ import annotations

from typing import no_type_check

import warp as wp

from .compiled import Floats, Floats2, Floats3, Ints, Longs, Longs2, Matrices, Vectors, kernel, part

_SMALL_ANGLE_SQUARED, _LEAST_LENGTH = wp.constant(1e-6), wp.constant(1e-12)
_ROOT, _PLACE, _FLEX, _NUMBERS = (wp.constant(value) for value in (0, 3, 15, 12))
_NORMAL, _ROTATION, _POSE, _POSE_CHANNELS = (wp.constant(value) for value in (0, 3, 12, 9))


@part
@no_type_check
def rotation_of(axis_angle: wp.vec3) -> wp.mat33:
    """Compute the matrix of an axis-angle, rad, as `geometry.torch_rotation.axis_angle_to_matrix`."""
    squared = wp.dot(axis_angle, axis_angle)
    sine = 1.0 - squared / 6.0
    cosine = 0.5 - squared / 24.0
    if squared >= _SMALL_ANGLE_SQUARED:
        angle = wp.sqrt(squared)
        sine = wp.sin(angle) / angle
        cosine = (1.0 - wp.cos(angle)) / squared
    cross = wp.skew(axis_angle)
    return wp.identity(n=3, dtype=wp.float32) + sine * cross + cosine * (cross * cross)


@part
@no_type_check
def _store(transforms: Floats2, row: int, turn: wp.mat33, shift: wp.vec3):
    for axis in range(3):
        for column in range(3):
            transforms[row, 4 * axis + column] = turn[axis, column]
        transforms[row, 4 * axis + 3] = shift[axis]


@kernel
@no_type_check
def joint_motions(
    theta: Vectors, forearm: Vectors, rest_joints: Vectors, parents: Ints, features: Floats, transforms: Floats2
):
    """Fill how joints move from rest to the pose, and the features of pose correctives.

    `transforms` [J + 1, 12] are [3, 4] row by row: of each joint, and last what the forearm adds at a weight of 1.
    """
    joint = wp.tid()
    joints = rest_joints.shape[0]
    if joint == joints:
        by = rotation_of(forearm[0]) - wp.identity(n=3, dtype=wp.float32)
        wrist = rotation_of(theta[_ROOT])
        _store(transforms, joint, wrist * by, -(wrist * (by * rest_joints[_ROOT])))
        return
    turn = rotation_of(theta[joint])
    if joint > 0:
        for row in range(3):
            for column in range(3):
                own = turn[row, column]
                if row == column:
                    own -= 1.0
                features[9 * (joint - 1) + 3 * row + column] = own
    shift = rest_joints[joint]
    at = int(parents[joint])
    if at >= 0:
        shift = rest_joints[joint] - rest_joints[at]
    while at >= 0:
        above = rotation_of(theta[at])
        from_parent = rest_joints[at]
        if parents[at] >= 0:
            from_parent = rest_joints[at] - rest_joints[parents[at]]
        shift = above * shift + from_parent
        turn = above * turn
        at = int(parents[at])
    _store(transforms, joint, turn, shift - turn * rest_joints[joint])


@kernel
@no_type_check
def skin_vertices(
    at_rest: Vectors,
    shape_directions: Floats3,
    pose_directions: Floats3,
    weights: Floats2,
    arm_weights: Floats,
    beta: Floats,
    features: Floats,
    transforms: Floats2,
    transl: Vectors,
    values: Floats2,
):
    """Fill how a pose moves vertices: values [V, 15] or more are the unposed place, m, and a transform [3, 4].

    Directions [V, 3, K] are of shape and of pose correctives.
    """
    vertex = wp.tid()
    for axis in range(3):
        shaped = float(at_rest[vertex][axis])
        for k in range(beta.shape[0]):
            shaped += shape_directions[vertex, axis, k] * beta[k]
        corrected = wp.float32(0.0)
        for k in range(features.shape[0]):
            corrected += pose_directions[vertex, axis, k] * features[k]
        values[vertex, axis] = shaped + corrected
    joints = weights.shape[1]
    for number in range(_NUMBERS):
        total = wp.float32(0.0)
        for joint in range(joints):
            total += weights[vertex, joint] * transforms[joint, number]
        total += arm_weights[vertex] * transforms[joints, number]
        if number % 4 == 3:
            total += transl[0][number / 4]
        values[vertex, _PLACE + number] = total


@part
@no_type_check
def _off_pose(values: Floats2, place: wp.vec3, vertex: int) -> float:
    """Compute the largest difference of a coordinate, m, between a moved vertex and where it was given."""
    off = wp.float32(0.0)
    for axis in range(3):
        at = _PLACE + 4 * axis
        moved = values[vertex, at + 3]
        for k in range(3):
            moved += values[vertex, at + k] * values[vertex, k]
        off = wp.max(off, wp.abs(moved - place[axis]))
    return off


@kernel
@no_type_check
def mesh_surface(
    vertices: Vectors,
    faces: Longs2,
    start: Longs,
    around: Longs,
    values: Floats2,
    normals: Vectors,
    area_m2: Floats,
    farthest_bits: Ints,
):
    """Fill unit normals of vertices and a third of the area of the faces around each, in order.

    Raises the bits of how far a vertex is from where its pose moves it, m; `values` are of `skin_vertices`.
    """
    row = wp.tid()
    total = wp.vec3()
    area = wp.float32(0.0)
    for entry in range(int(start[row]), int(start[row + 1])):
        face = int(around[entry])
        a = vertices[int(faces[face, 0])]
        of_face = wp.cross(vertices[int(faces[face, 1])] - a, vertices[int(faces[face, 2])] - a)
        total += of_face
        area += wp.length(of_face) / 6.0
    normals[row] = total / wp.max(wp.length(total), _LEAST_LENGTH)
    area_m2[row] = area
    wp.atomic_max(farthest_bits, 0, wp.cast(_off_pose(values, vertices[row], row), wp.int32))


@part
@no_type_check
def turned_surface(
    vertices: Vectors, normal: wp.vec3, neighbours: Longs2, weights: Floats2, rest_frame: wp.mat33, vertex: int
) -> wp.mat33:
    """Compute the rotation of the surface about a vertex, from the canonical template."""
    tangent = wp.vec3()
    for k in range(neighbours.shape[1]):
        tangent += weights[vertex, k] * (vertices[int(neighbours[vertex, k])] - vertices[vertex])
    tangent = tangent - wp.dot(tangent, normal) * normal
    tangent = tangent / wp.max(wp.length(tangent), _LEAST_LENGTH)
    across = wp.cross(normal, tangent)
    turn = wp.mat33()
    for row in range(3):
        for column in range(3):
            turn[row, column] = (
                tangent[row] * rest_frame[0, column]
                + across[row] * rest_frame[1, column]
                + normal[row] * rest_frame[2, column]
            )
    return turn


@kernel
@no_type_check
def local_rotations(
    vertices: Vectors, normals: Vectors, neighbours: Longs2, weights: Floats2, rest_frames: Matrices, out: Matrices
):
    """Fill rotations [V] as `geometry.local_rotation.local_rotations`."""
    vertex = wp.tid()
    out[vertex] = turned_surface(vertices, normals[vertex], neighbours, weights, rest_frames[vertex], vertex)


@kernel
@no_type_check
def vertex_conditions(
    vertices: Vectors,
    normals: Vectors,
    neighbours: Longs2,
    weights: Floats2,
    rest_frames: Matrices,
    lbs_weights: Floats2,
    joint_pose: Floats2,
    rest: Vectors,
    mirror: Vectors,
    scale: Floats,
    on_pose_bits: int,
    farthest_bits: Ints,
    flex: Floats,
    channels: Floats2,
    values: Floats2,
):
    """Fill the field's channels of vertices: normal, rotation and blended pose; and the last of values, the bend.

    Where a vertex of the hand is farther from its pose than `on_pose_bits`, values become the motion of all vertices by
    `surface.detail_mesh.skin_motion_of`. `joint_pose` [J, 9] is what `vertex_local_pose` blends.
    """
    vertex = wp.tid()
    normal = normals[vertex]
    turn = turned_surface(vertices, normal, neighbours, weights, rest_frames[vertex], vertex)
    for axis in range(3):
        channels[vertex, _NORMAL + axis] = normal[axis]
        for column in range(3):
            channels[vertex, _ROTATION + 3 * axis + column] = turn[axis, column]
    for k in range(_POSE_CHANNELS):
        blended = wp.float32(0.0)
        for joint in range(lbs_weights.shape[1]):
            blended += lbs_weights[vertex, joint] * joint_pose[joint, k]
        channels[vertex, _POSE + k] = blended
    values[vertex, _FLEX] = flex[vertex]
    if farthest_bits[0] > on_pose_bits:
        at_rest = rest[vertex]
        for axis in range(3):
            moved = wp.float32(0.0)
            for column in range(3):
                entry = scale[0] * turn[axis, column] * mirror[0][column]
                values[vertex, _PLACE + 4 * axis + column] = entry
                moved += entry * at_rest[column]
            values[vertex, _PLACE + 4 * axis + 3] = vertices[vertex][axis] - moved
            values[vertex, axis] = at_rest[axis]
