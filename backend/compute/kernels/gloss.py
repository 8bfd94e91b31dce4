"""Equals `glossy` of `light.lighting`."""

from __future__ import annotations

import numpy as np

from .compiled import compiled_part_loosely as part

_0, _QUARTER, _HALF, _1 = (np.float32(value) for value in (0, 0.25, 0.5, 1))
LEAST_COSINE, GRAZING, TINY = np.float32(1e-4), np.float32(0.05), np.float32(1e-8)
"""Of the cosines to light and eye, and of what is divided by, as there."""


@part
def widened(alpha, light_radius_rad):
    """Squared alpha of a lobe, widened by the light."""
    return min(alpha * alpha + light_radius_rad * light_radius_rad * _QUARTER, _1)


@part
def fresnel(cosine, squared_index):
    """As `light.gloss.fresnel`."""
    cosine = min(max(cosine, _0), _1)
    inside = np.sqrt(squared_index - _1 + cosine * cosine)
    less, more = inside - cosine, inside + cosine
    straight, across = less / more, (cosine * more - _1) / (cosine * less + _1)
    return _HALF * straight * straight * (_1 + across * across)


@part
def on_nail(nail, lobes):
    """Squared alpha of the first lobe."""
    alpha = lobes.alpha[0] + (lobes.nail_alpha - lobes.alpha[0]) * nail
    return alpha * alpha


@part
def glossy(to_light, x, y, z, normal, view, light_radius_rad, alphas_squared, squared_index, both):
    """Fill the two lobes for a light in direction (x, y, z), whose cosine to the normal is `to_light` > 0."""
    hx, hy, hz = x - view[0], y - view[1], z - view[2]
    length = max(np.sqrt(hx * hx + hy * hy + hz * hz), TINY)
    hx, hy, hz = hx / length, hy / length, hz / length
    to_eye = max(-(normal[0] * view[0] + normal[1] * view[1] + normal[2] * view[2]), GRAZING)
    to_half = min(max(normal[0] * hx + normal[1] * hy + normal[2] * hz, _0), _1)
    reflectance = fresnel(x * hx + y * hy + z * hz, squared_index)
    to_light = max(to_light, LEAST_COSINE)
    for lobe in range(2):
        squared = min(alphas_squared[lobe] + light_radius_rad * light_radius_rad * _QUARTER, _1)
        base = to_half * to_half * (squared - _1) + _1
        shadowing = to_light * np.sqrt(to_eye * to_eye * (_1 - squared) + squared) + to_eye * np.sqrt(
            to_light * to_light * (_1 - squared) + squared
        )
        both[lobe] = squared / (base * base) * _HALF / shadowing * reflectance * to_light
