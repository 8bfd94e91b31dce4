"""The person's numbers: the skin of our family that comes nearest to what the pictures show, and the prior by place.

Pigments absorb exponentially, so that the logarithm of the albedo of a skin is linear in melanin and in blood. A grey
factor is the strength of the light, which the same pictures do not tell apart from a lighter skin; a tint is the
camera's white balance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

BLOOD_LOG_ALBEDO = (-0.03, -0.38, -0.58)
"""By which blood of 1 more changes the logarithm of albedo."""
_BLOOD_DEVIATION, _TINT_DEVIATION = 0.5, 0.06
_MELANIN_STEPS = 121
_MOST_MELANIN = 1.2
_MOST_ERROR = 0.5
_GREEN_PURPLE, _RED_BLUE = np.array([-1.0, 2.0, -1.0]) / 6**0.5, np.array([1.0, 0.0, -1.0]) / 2**0.5


@dataclass(frozen=True)
class ToneFamily:
    """Logarithms of the albedo of a light and of a deep skin [N, 3], at vertices of the surface."""

    light: np.ndarray
    deep: np.ndarray

    def log_albedo(self, melanin: float, blood: float) -> np.ndarray:
        """Compute the logarithm [N, 3] of the albedo of a person."""
        return (1 - melanin) * self.light + melanin * self.deep + (blood - 1) * np.array(BLOOD_LOG_ALBEDO)


class ToneFit(NamedTuple):
    """What explains an observed albedo.

    Attributes:
        melanin: 0 light to 1 deep.
        blood: 1 is usual.
        log_gain: of the light's strength over what was assumed.
        log_tint: [3] of the camera's white balance; its mean is 0.
        error: mean of the logarithm's error that is left.
    """

    melanin: float
    blood: float
    log_gain: float
    log_tint: np.ndarray
    error: float


def fitted_numbers(family: ToneFamily, log_albedo: np.ndarray, weight: np.ndarray) -> ToneFit:
    """Fit the numbers to an observed albedo.

    Args:
        family: of skins.
        log_albedo: [N, 3] its logarithm, where it was seen.
        weight: [N] 0 where it was not.
    """
    share = weight / weight.sum()
    columns = np.stack([np.ones(3), np.array(BLOOD_LOG_ALBEDO), _GREEN_PURPLE, _RED_BLUE], 1)
    deviations = np.array([np.inf, _BLOOD_DEVIATION, _TINT_DEVIATION, _TINT_DEVIATION])
    priors = np.diag(1 / deviations)[1:]
    best: tuple[float, ToneFit] | None = None
    for melanin in np.linspace(0, _MOST_MELANIN, _MELANIN_STEPS):
        left = log_albedo - family.log_albedo(melanin, 1.0)
        mean = share @ left
        # The mean over a hand is known to some hundredths: prior and data meet there.
        stacked = np.concatenate([columns / _MEAN_DEVIATION, priors])
        found = np.linalg.lstsq(stacked, np.concatenate([mean / _MEAN_DEVIATION, np.zeros(3)]), rcond=None)[0]
        rest = np.minimum(np.abs(left - columns @ found), _MOST_ERROR)
        error = float(share @ rest.mean(1))
        cost = error + _PRIOR_SHARE * float((priors @ found) @ (priors @ found))
        if best is None or cost < best[0]:
            tint = found[2] * _GREEN_PURPLE + found[3] * _RED_BLUE
            best = cost, ToneFit(float(melanin), 1 + float(found[1]), float(found[0]), tint, error)
    assert best is not None
    return best[1]


_MEAN_DEVIATION = 0.02
_PRIOR_SHARE = 0.01
