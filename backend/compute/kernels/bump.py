"""Equals `light.bump`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_part_loosely as part

_0, _HALF, _1, _2 = (np.float32(value) for value in (0, 0.5, 1, 2))
LEAST_MIRRORED, LEAST_OF_EYE, TINY, LEAST_BEND = (np.float32(value) for value in (0.01, 0.9, 1e-8, 1e-4))
"""As there."""


@part
def bump_shadowing(facing, x, y, z, along, surface_normal):
    """Of a light in direction (x, y, z), whose cosine to the normal is `facing`; `along`: of both normals."""
    share = x * surface_normal[0] + y * surface_normal[1] + z * surface_normal[2]
    share = min(max(share / max(facing * along, TINY), _0), _1)
    return share * (_1 + share - share * share)


@part
def leaving_share(above, to_eye, alpha_squared):
    """Of a lobe; `above`: cosine of the mirrored view and the surface's normal, `to_eye`: and the bump's own."""
    share, whole = _part_of_lobe(above, alpha_squared), _part_of_lobe(max(to_eye, _0), alpha_squared)
    return min(share / whole, _1)


@part
def _part_of_lobe(cosine, alpha_squared):
    tangent = cosine / (_1 + np.sqrt(max(_1 - cosine * cosine, _0)))
    return _1 + tangent / np.sqrt(alpha_squared + tangent * tangent)


@part
def mirroring_normal(normal, surface_normal, view, along, out):
    """Fill out [3]; `along`: cosine of both normals."""
    up = -(surface_normal[0] * view[0] + surface_normal[1] * view[1] + surface_normal[2] * view[2])
    facing = -(normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2])
    least = min(LEAST_OF_EYE * up, LEAST_MIRRORED)
    for k in range(3):
        out[k] = normal[k]
    if up <= _0 or _2 * facing * along - up >= least:
        return
    bend = np.sqrt(max(_1 - along * along, _0))
    if bend <= LEAST_BEND:
        return
    across = (facing - along * up) / bend
    reach = np.arccos(min(least / max(np.sqrt(up * up + across * across), TINY), _1))
    kept = _HALF * (np.arctan2(across, up) + reach)
    cosine, sine = np.cos(kept), np.sin(kept) / bend
    for k in range(3):
        out[k] = cosine * surface_normal[k] + sine * (normal[k] - along * surface_normal[k])
