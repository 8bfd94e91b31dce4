"""The inverse of a view transform: which colours to render so that the view shows the wanted ones.

The inverse is found on a grid of colours by damped Gauss-Newton steps against a function that says what the view shows,
and interpolated in between. Colours are linear and straight. They are sought as non-negative Rec.2020, which reaches
more of what AgX can show than Rec.709 does; `code` is log2 of them, `axis` the 2.4th root of a Rec.709 component,
[N, 3] both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

Show = Callable[[np.ndarray], np.ndarray]
"""[N, 3] linear Rec.709 -> [N, 3] displayed values in [0, 1]."""

GRID_SIZE = 33
_STEPS = 10
_AXIS_POWER = 2.4
_CODE_RANGE = (-14.0, 8.0)
# The step of the finite differences: large enough for 16 bits, small against the curvature of any view.
_PROBE = 0.05
_REC2020_TO_REC709 = np.array(
    [[1.660491, -0.587641, -0.072850], [-0.124550, 1.132900, -0.008349], [-0.018151, -0.100579, 1.118730]]
)


@dataclass(frozen=True)
class ViewInverse:
    """A view's inverse, tabulated.

    Attributes:
        codes: [GRID_SIZE, GRID_SIZE, GRID_SIZE, 3] the code to render for each colour of the grid.
        error: what the view shows of these codes is off by this much, in the median colour's worst channel.
    """

    codes: np.ndarray
    error: float

    @classmethod
    def solve(cls, show: Show, show_wanted: Show) -> ViewInverse:
        """Find the colours that `show` displays as `show_wanted` displays the grid's."""
        ticks = np.linspace(0, 1, GRID_SIZE)
        rgb = np.stack(np.meshgrid(ticks, ticks, ticks, indexing="ij"), -1).reshape(-1, 3) ** _AXIS_POWER
        code, error = _solve(rgb, show_wanted(rgb), show)
        return cls(code.reshape(GRID_SIZE, GRID_SIZE, GRID_SIZE, 3), float(np.median(np.abs(error).max(-1))))

    def __call__(self, rgb_linear: np.ndarray) -> np.ndarray:
        """Map wanted colours [..., 3] to those to render; both linear Rec.709, the former clipped to [0, 1].

        Saturated colours beyond Rec.709 have a negative component.
        """
        axis = np.clip(rgb_linear, 0, 1).reshape(-1, 3) ** (1 / _AXIS_POWER)
        return _rgb_of_code(interpolated(self.codes, axis)).reshape(rgb_linear.shape).astype(rgb_linear.dtype)


def _solve(rgb: np.ndarray, wanted: np.ndarray, show: Show) -> tuple[np.ndarray, np.ndarray]:
    """Find codes that are shown as `wanted` [N, 3], starting from `rgb`, and the remaining error [N, 3].

    Each colour has its own Levenberg damping: steps stay short where the view is flat or cannot show the colour.
    """
    code = np.log2(np.maximum(rgb @ np.linalg.inv(_REC2020_TO_REC709).T, 2.0**-10))
    error, slopes = _linearised(code, wanted, show)
    damping = np.full(len(rgb), 1e-4)
    for _ in range(_STEPS):
        normal = slopes.transpose(0, 2, 1) @ slopes + damping[:, None, None] * np.eye(3)
        step = np.linalg.solve(normal, slopes.transpose(0, 2, 1) @ error[..., None])[..., 0]
        trial = np.clip(code - np.clip(step, -2, 2), *_CODE_RANGE)
        new_error, new_slopes = _linearised(trial, wanted, show)
        better = (new_error**2).sum(-1) < (error**2).sum(-1)
        code = np.where(better[:, None], trial, code)
        error = np.where(better[:, None], new_error, error)
        slopes = np.where(better[:, None, None], new_slopes, slopes)
        damping = np.clip(np.where(better, damping / 4, damping * 8), 1e-8, 10)
    return code, error


def _linearised(code: np.ndarray, wanted: np.ndarray, show: Show) -> tuple[np.ndarray, np.ndarray]:
    """Compute how far shown colours exceed the wanted ones [N, 3], and their slopes by code [N, 3 shown, 3 code]."""
    codes = np.stack([code, *(code + _PROBE * axis for axis in np.eye(3))])
    shown = show(_rgb_of_code(codes.reshape(-1, 3))).reshape(codes.shape)
    return shown[0] - wanted, np.moveaxis((shown[1:] - shown[0]) / _PROBE, 0, -1)


def _rgb_of_code(code: np.ndarray) -> np.ndarray:
    return np.exp2(code) @ _REC2020_TO_REC709.T


def interpolated(table: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """Interpolate [N, 3], trilinear between the table's points, spaced evenly along `axis` [N, 3] in [0, 1]."""
    place = axis * (len(table) - 1)
    low = np.minimum(place.astype(int), len(table) - 2)
    part = place - low
    total = np.zeros_like(place)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, part, 1 - part), -1, keepdims=True)
        total += weight * table[tuple((low + corner).T)]
    return total
