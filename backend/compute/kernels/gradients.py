"""Features at samples with their gradients, for training: as `field.shade.shade` of a `PlaneField`.

As `field.encoding.FeaturePlane`, `field.conditions.gather_field_inputs` and `field.volume.composite`. `gathered` [S, K]
of S = R * N samples: planes' features, height, height^2, local pose, normal, relief normal, light. The vertices'
channels are as in `kernels.field`.
"""

from __future__ import annotations

import numpy as np

from .compiled import compiled_loosely as compiled
from .field import BLOCK, POSE, ROTATION, plane_cell, texel_at, write_normals

_0, _HALF, _1, _2, _MIN_ALPHA, _MIN_LENGTH = (np.float32(value) for value in (0, 0.5, 1, 2, 1e-6, 1e-12))
_BLOCK = np.uintp(BLOCK)
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


@compiled
def read_samples(table, sizes, uv, height, fade, first, last, out, columns, at):
    """Write the features of samples [first, last), times `fade`, to columns [at, at + channels) of `out`.

    Here and below: `table`, `out` and the features' gradient are flat, rows of the last two have so many `columns`;
    sizes = (resolution, heights, channels), any number of channels; uv [S, 2], height [S], fade [S].
    """
    resolution, heights, channels = sizes
    row_size, texel_size = np.uintp(resolution * heights * channels), np.uintp(heights * channels)
    above = np.uintp(channels if heights > 1 else 0)
    for sample in range(first, last):
        a, fx, fy, share = plane_cell(uv[sample, 0], uv[sample, 1], height[sample], sizes)
        corners = a, a + texel_size, a + row_size, a + row_size + texel_size
        low, high = fade[sample] * (_1 - fy), fade[sample] * fy
        weights = (_1 - fx) * low, fx * low, (_1 - fx) * high, fx * high
        to, done = np.uintp(sample * columns + at), np.uintp(0)
        while done + _BLOCK <= np.uintp(channels):
            for k in range(_BLOCK):
                below = _bilinear(table, corners, done + k, weights)
                out[to + done + k] = below + share * (_bilinear(table, corners, done + k + above, weights) - below)
            done += _BLOCK
        while done < np.uintp(channels):
            below = _bilinear(table, corners, done, weights)
            out[to + done] = below + share * (_bilinear(table, corners, done + above, weights) - below)
            done += np.uintp(1)


@compiled
def table_gradient(sizes, uv, height, fade, outward, columns, at, first, last, gradient):
    """Add to `gradient`, of rows [first, last) of the flat table, what the features' gradient `outward` gives.

    Each texel's sum runs in the order of the samples, so that the result is bit-identical for any split of the rows.
    """
    resolution, heights, channels = sizes
    row_size, texel_size = np.uintp(resolution * heights * channels), np.uintp(heights * channels)
    above = np.uintp(channels)
    for sample in range(len(uv)):
        y, fy = texel_at(uv[sample, 1] * np.float32(resolution) - _HALF, resolution)
        if y + 1 < first or y >= last:
            continue
        cell, fx, fy, share = plane_cell(uv[sample, 0], uv[sample, 1], height[sample], sizes)
        source = np.uintp(sample * columns + at)
        for side in range(2):
            if first <= y + side < last:
                weight = fade[sample] * (fy if side == 1 else _1 - fy)
                left, low = cell + np.uintp(side) * row_size, _1 - share
                right = left + texel_size
                _add(gradient, left, outward, source, above, (_1 - fx) * weight * low)
                _add(gradient, right, outward, source, above, fx * weight * low)
                if heights > 1:
                    _add(gradient, left + above, outward, source, above, (_1 - fx) * weight * share)
                    _add(gradient, right + above, outward, source, above, fx * weight * share)


@compiled
def place_gradient(table, sizes, uv, height, fade, outward, columns, at, first, last, gradient):
    """Add the gradients of u, v, height and fade of samples [first, last) to `gradient` [S, 4]."""
    resolution, heights, channels = sizes
    row_size, texel_size = np.uintp(resolution * heights * channels), np.uintp(heights * channels)
    for sample in range(first, last):
        cell, fx, fy, share = plane_cell(uv[sample, 0], uv[sample, 1], height[sample], sizes)
        source = np.uintp(sample * columns + at)
        a = _dots(table, cell, outward, source, sizes)
        b = _dots(table, cell + texel_size, outward, source, sizes)
        c = _dots(table, cell + row_size, outward, source, sizes)
        d = _dots(table, cell + row_size + texel_size, outward, source, sizes)
        mean_a, mean_b = a[0] + share * (a[1] - a[0]), b[0] + share * (b[1] - b[0])
        mean_c, mean_d = c[0] + share * (c[1] - c[0]), d[0] + share * (d[1] - d[0])
        along_x = (_1 - fy) * (mean_b - mean_a) + fy * (mean_d - mean_c)
        along_y = (_1 - fx) * (mean_c - mean_a) + fx * (mean_d - mean_b)
        along_layers = (_1 - fy) * ((_1 - fx) * (a[1] - a[0]) + fx * (b[1] - b[0]))
        along_layers += fy * ((_1 - fx) * (c[1] - c[0]) + fx * (d[1] - d[0]))
        per_texel = fade[sample] * np.float32(resolution)
        for axis, along in enumerate((along_x, along_y)):
            position = uv[sample, axis] * np.float32(resolution) - _HALF
            if _0 <= position <= np.float32(resolution - 1):
                gradient[sample, axis] += per_texel * along
        if heights > 1 and -_1 <= height[sample] <= _1:
            gradient[sample, 2] += fade[sample] * along_layers * np.float32(heights - 1) / _2
        gradient[sample, 3] += mean_a + fx * (mean_b - mean_a) + fy * along_y


@compiled
def _bilinear(table, corners, offset, weights):
    """Interpolate one feature between four corners of a layer."""
    below = weights[0] * table[corners[0] + offset] + weights[1] * table[corners[1] + offset]
    return below + weights[2] * table[corners[2] + offset] + weights[3] * table[corners[3] + offset]


@compiled
def _add(gradient, to, outward, source, channels, weight):
    """Add weight * outward[source :] to gradient[to :], `channels` of them."""
    done = np.uintp(0)
    while done + _BLOCK <= channels:
        for k in range(_BLOCK):
            gradient[to + done + k] += weight * outward[source + done + k]
        done += _BLOCK
    while done < channels:
        gradient[to + done] += weight * outward[source + done]
        done += np.uintp(1)


@compiled
def _dots(table, corner, outward, source, sizes):
    """Compute inner products of the features' gradient with a corner's features, and with those of the layer above."""
    _, heights, channels = sizes
    low = high = _0 * outward[source]
    for k in range(np.uintp(channels)):
        low += table[corner + k] * outward[source + k]
        if heights > 1:
            high += table[corner + np.uintp(channels) + k] * outward[source + k]
    return low, high
