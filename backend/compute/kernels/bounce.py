"""Equals `light.bounce.bounced`."""

from __future__ import annotations

from math import pi

import numpy as np

from .compiled import compiled_loosely as compiled
from .compiled import compiled_part_loosely as part

_0, _1, _PI, _LEAST_SQUARED_M = (np.float32(value) for value in (0, 1, pi, 1e-8))


@compiled
def bounce(position, normal, probes, first, last, received):
    """Fill what points [first, last) receive from probes (`ProbeArrays`)."""
    factors = np.empty(probes.shed.shape[1], np.float32)
    for point in range(first, last):
        _fill_factors(position[point], normal[point], probes, factors)
        _fill_received(factors, probes.shed, received[point])


@part
def _fill_factors(position, normal, probes, factors):
    """The form factors of a point and all probes; apart from their sums, so that this becomes vector instructions."""
    x, y, z = position[0], position[1], position[2]
    nx, ny, nz = normal[0], normal[1], normal[2]
    for k in range(np.uintp(len(factors))):
        dx, dy, dz = probes.position[0, k] - x, probes.position[1, k] - y, probes.position[2, k] - z
        squared = dx * dx + dy * dy + dz * dz
        here = max(dx * nx + dy * ny + dz * nz, _0)
        there = max(-(dx * probes.normal[0, k] + dy * probes.normal[1, k] + dz * probes.normal[2, k]), _0)
        area_m2 = probes.area_m2[k]
        factors[k] = here * there * area_m2 / (max(squared, _LEAST_SQUARED_M) * (_PI * squared + area_m2))


@part
def _fill_received(factors, shed, out):
    """Fill out [3] with what arrives by these form factors."""
    total, red, green, blue = _0, _0, _0, _0
    for k in range(np.uintp(len(factors))):
        factor = factors[k]
        total += factor
        red += factor * shed[0, k]
        green += factor * shed[1, k]
        blue += factor * shed[2, k]
    most = max(total, _1)
    out[0] = red / most
    out[1] = green / most
    out[2] = blue / most
