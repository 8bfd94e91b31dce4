"""Equals `field.conditions.gather_field_inputs` and the per-sample half of `field.field.PlaneField`, with gradients.

`gathered` [S, K] of S = R * N samples: planes' features, height, height^2, local pose, normal, relief normal, light.
Flat arrays and their columns as in `planes`; the vertices' channels as in `fused`.
"""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .fused import POSE, ROTATION, write_normals

_0, _1, _MIN_ALPHA, _MIN_LENGTH = (np.float32(value) for value in (0, 1, 1e-6, 1e-12))
_RELIEF = 3
"""Where the relief normal begins after the normal."""


@compiled
def atlas_coordinates(face, barycentric, corner_uv, first, last, uv):
    """Fill the atlas coordinates [S, 2] of samples [first, last)."""
    for sample in range(first, last):
        f, wa, wb, wc = face[sample], barycentric[sample, 0], barycentric[sample, 1], barycentric[sample, 2]
        for k in range(2):
            uv[sample, k] = wa * corner_uv[f, 0, k] + wb * corner_uv[f, 1, k] + wc * corner_uv[f, 2, k]


@compiled
def gather_features(
    face,  # [S]
    barycentric,  # [S, 3]
    height,  # [S] in units of the shell
    relief,  # [S, 3] offset of the normal, canonical
    faces,  # [F, 3]
    channels,  # [V, C]: normal 3, rotation 9, local pose, light
    pose_channels,
    first,
    last,
    gathered,  # flat [S, columns] out
    columns,
    at,  # the column of the height
):
    """Fill the gathered features of samples [first, last), except those of the planes."""
    here = np.empty(channels.shape[1], np.float32)
    for sample in range(first, last):
        _blend(face, barycentric, faces, channels, sample, here)
        to = sample * columns + at
        gathered[to], gathered[to + 1] = height[sample], height[sample] * height[sample]
        for k in range(pose_channels):
            gathered[to + 2 + k] = here[POSE + k]
        to += 2 + pose_channels
        write_normals(here, relief[sample], gathered, to)
        for k in range(len(here) - POSE - pose_channels):
            gathered[to + 6 + k] = here[POSE + pose_channels + k]


@compiled
def relief_gradient(face, barycentric, relief, faces, channels, gathered, outward, columns, at, first, last, gradient):
    """Fill the gradient [S, 3] of the relief's offset from `outward`, gathered's gradient; normals begin at `at`."""
    here = np.empty(POSE, np.float32)
    turned = np.empty(3, np.float32)
    for sample in range(first, last):
        _blend(face, barycentric, faces, channels, sample, here)
        normal, tilted = sample * columns + at, sample * columns + at + _RELIEF
        squared, along = _0, _0
        for row in range(3):
            r = ROTATION + 3 * row
            x = gathered[normal + row]
            for k in range(3):
                x += here[r + k] * relief[sample, k]
            squared += x * x
            along += gathered[tilted + row] * outward[tilted + row]
        length = max(np.sqrt(squared), _MIN_LENGTH)
        for row in range(3):
            turned[row] = (outward[tilted + row] - along * gathered[tilted + row]) / length
        for k in range(3):
            r = ROTATION + k
            gradient[sample, k] = here[r] * turned[0] + here[r + 3] * turned[1] + here[r + 6] * turned[2]


@compiled
def vertex_gradient(face, barycentric, faces, outward, columns, at, gradient):
    """Add the gradient of vertices' values [V, E], which lie in columns [at, at + E) of the gathered features."""
    for sample in range(len(face)):
        source = np.uintp(sample * columns + at)
        for corner in range(3):
            vertex, weight = faces[face[sample], corner], barycentric[sample, corner]
            for k in range(gradient.shape[1]):
                gradient[vertex, k] += weight * outward[source + np.uintp(k)]


@compiled
def composite_rays(clear, t, gathered, first, last, weights, after, channels, alpha, depth):
    """Composite rays [first, last), whose steps have transmittance `clear` [R, N].

    Fills weights and the transmittance after each sample [R, N], channels [R, K], alpha [R] and mean depth [R].
    """
    count, columns = clear.shape[1], channels.shape[1]
    for ray in range(first, last):
        through, total, reach = _1, _0, _0
        channels[ray] = _0
        for index in range(count):
            left = through * clear[ray, index]
            weight = through * (_1 - clear[ray, index])
            weights[ray, index], after[ray, index], through = weight, left, left
            total += weight
            reach += weight * t[ray, index]
            source = np.uintp((ray * count + index) * columns)
            for k in range(columns):
                channels[ray, k] += weight * gathered[source + np.uintp(k)]
        alpha[ray], depth[ray] = total, reach / max(total, _MIN_ALPHA)


@compiled
def composite_gradient(
    t, gathered, weights, after, alpha, depth, of_channels, of_alpha, of_depth, first, last, of_gathered, of_optical
):
    """Fill the gradients of gathered features (flat) and optical depths [R, N] from those of the composite."""
    count, columns = weights.shape[1], of_channels.shape[1]
    for ray in range(first, last):
        per_depth = of_depth[ray] / max(alpha[ray], _MIN_ALPHA)
        reached = depth[ray] if alpha[ray] >= _MIN_ALPHA else _0
        behind = _0
        for index in range(count - 1, -1, -1):
            weight, start = weights[ray, index], np.uintp((ray * count + index) * columns)
            along = of_alpha[ray] + per_depth * (t[ray, index] - reached)
            for k in range(columns):
                along += of_channels[ray, k] * gathered[start + np.uintp(k)]
                of_gathered[start + np.uintp(k)] = weight * of_channels[ray, k]
            of_optical[ray, index] = along * after[ray, index] - behind
            behind += along * weight


@compiled
def _blend(face, barycentric, faces, channels, sample, here):
    """Fill `here` with the first of the vertices' channels, interpolated at a sample."""
    f = face[sample]
    a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
    wa, wb, wc = barycentric[sample, 0], barycentric[sample, 1], barycentric[sample, 2]
    for k in range(len(here)):
        here[k] = wa * channels[a, k] + wb * channels[b, k] + wc * channels[c, k]
