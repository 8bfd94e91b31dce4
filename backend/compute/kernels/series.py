"""Exponentials and logarithms by short series, which become vector instructions; calls of the C library do not."""

from __future__ import annotations

from math import log

import numpy as np

from .compiled import compiled_part_loosely as part

_HALF, _1, _16, _LEAST = (np.float32(value) for value in (0.5, 1, 16, 1e-12))
_OF_LOG2 = np.float32(2 / log(2))
_THIRD, _FIFTH, _SIXTH, _SEVENTH, _EIGHTH = (np.float32(1 / value) for value in (3, 5, 6, 7, 8))
_24TH, _120TH, _720TH = (np.float32(1 / value) for value in (24, 120, 720))


@part
def decayed(part):
    """Compute exp(-16 part) = (1 / exp(part))^16: exact to 3e-6."""
    decay = _1 / (_1 + part * (_1 + part * (_HALF + part * (_SIXTH + part * _24TH))))
    decay *= decay
    decay *= decay
    decay *= decay
    return decay * decay


@part
def gaussian(off):
    """Compute exp(-off^2), as exact as `decayed`."""
    return decayed(off * off / _16)


@part
def grown(logarithm):
    """Compute exp(logarithm) = exp(logarithm / 8)^8, of either sign: exact to 1e-6 up to 2, to 1e-3 up to 5."""
    part = logarithm * _EIGHTH
    growth = _1 + part * (_1 + part * (_HALF + part * (_SIXTH + part * (_24TH + part * (_120TH + part * _720TH)))))
    growth *= growth
    growth *= growth
    return growth * growth


@part
def octaves(one, other):
    """Compute log2(other / one) of positive numbers: exact to 1e-4 up to twice or half as much, to .1 up to 8 times."""
    part = (other - one) / max(other + one, _LEAST)
    squared = part * part
    return _OF_LOG2 * part * (_1 + squared * (_THIRD + squared * (_FIFTH + squared * _SEVENTH)))
