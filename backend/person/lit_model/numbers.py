"""The person's numbers: the skin of our family that comes nearest to what the pictures show, and the prior by place.

Pigments absorb exponentially, so that the logarithm of the albedo of a skin is linear in melanin and in blood.

A lighter skin in a dimmer light has the same colours, and so has another skin under another white balance, but for
their highlights: light that is reflected at the surface has not met the pigment. So for each melanin the light is
fitted that explains the pictures best in it, and the melanin is taken whose light explains them best of all. What is
left is blood, a grey factor, the strength of the light, and a tint, the camera's white balance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...surface.atlas_texels import AtlasTexels
from ...surface.blood import BLOOD_LOG_ALBEDO
from ...system.parallel_map import parallel_map
from .illumination import LitPixels, fitted_light

_BLOOD_DEVIATION, _TINT_DEVIATION = 0.2, 0.06
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


def fitted_numbers(family: ToneFamily, log_albedo: np.ndarray, weight: np.ndarray, melanin: float) -> ToneFit:
    """Fit the other numbers to an observed albedo of a skin whose melanin is known.

    Args:
        family: of skins.
        log_albedo: [N, 3] its logarithm, where it was seen.
        weight: [N] 0 where it was not.
        melanin: 0 light to 1 deep.
    """
    share = weight / weight.sum()
    columns = np.stack([np.ones(3), np.array(BLOOD_LOG_ALBEDO), _GREEN_PURPLE, _RED_BLUE], 1)
    deviations = np.array([np.inf, _BLOOD_DEVIATION, _TINT_DEVIATION, _TINT_DEVIATION])
    left = log_albedo - family.log_albedo(melanin, 1.0)
    # The mean over a hand is known to some hundredths: prior and data meet there.
    stacked = np.concatenate([columns / _MEAN_DEVIATION, np.diag(1 / deviations)[1:]])
    found = np.linalg.lstsq(stacked, np.concatenate([share @ left / _MEAN_DEVIATION, np.zeros(3)]), rcond=None)[0]
    rest = np.minimum(np.abs(left - columns @ found), _MOST_ERROR)
    tint = found[2] * _GREEN_PURPLE + found[3] * _RED_BLUE
    return ToneFit(melanin, 1 + float(found[1]), float(found[0]), tint, float(share @ rest.mean(1)))


_MEAN_DEVIATION = 0.02
_MELANINS = np.linspace(0, 1.2, 13)
"""Of which every other one is tried first."""


class PixelTones(NamedTuple):
    """Pixels of one scene, and what is known of the skin that they show.

    Attributes:
        pixels: in the light of each lobe.
        log_ratio: [P, 3] logarithm of the albedo over that of the pixels' `diffuse`, of a skin without melanin.
        log_melanin: [P, 3] what melanin of 1 adds to it.
    """

    pixels: LitPixels
    log_ratio: np.ndarray
    log_melanin: np.ndarray

    def ratio(self, melanin: float) -> np.ndarray:
        """Compute the ratio [P, 3] of a skin with this melanin."""
        return np.exp(self.log_ratio + melanin * self.log_melanin)


def fitted_melanin(scenes: Sequence[PixelTones]) -> float:
    """Find the melanin, 0 light to 1.2, whose light explains all scenes best."""

    def error(melanin: float) -> float:
        return float(np.mean([fitted_light(one.pixels, one.ratio(melanin)).error for one in scenes]))

    errors = np.full(len(_MELANINS), np.inf)

    def measure(chosen: Sequence[int]) -> int:
        rows = list(chosen)
        errors[rows] = parallel_map(error, _MELANINS[rows].tolist())
        return int(errors.argmin())

    coarse = measure(range(0, len(_MELANINS), 2))
    best = measure([beside for beside in (coarse - 1, coarse + 1) if 0 <= beside < len(_MELANINS)])
    if best in (0, len(_MELANINS) - 1):
        return float(_MELANINS[best])
    below, least, above = errors[best - 1 : best + 2]
    step = _MELANINS[1] - _MELANINS[0]
    return float(_MELANINS[best] + step * (below - above) / (2 * (below - 2 * least + above)))


FIRST_MELANIN = 0.4
"""Before any picture is looked at."""


@dataclass(frozen=True)
class AtlasTone:
    """The albedo so far, over the base's, and how melanin changes it: logarithms at the texels [T, 3].

    Attributes:
        texels: of the atlas.
        bare: without melanin.
        per_melanin: what melanin of 1 adds.
        melanin: 0 light to 1 deep.
    """

    texels: AtlasTexels
    bare: np.ndarray
    per_melanin: np.ndarray
    melanin: float

    @classmethod
    def of_family(cls, texels: AtlasTexels, family: ToneFamily, base_log_albedo: np.ndarray) -> AtlasTone:
        """Begin with a skin of the family."""
        bare = texels.at_texels((family.log_albedo(0.0, 1.0) - base_log_albedo).astype(np.float32))
        per_melanin = texels.at_texels((family.deep - family.light).astype(np.float32))
        return cls(texels, bare, per_melanin, FIRST_MELANIN)

    def on(self, texels: AtlasTexels) -> AtlasTone:
        """Look the skin up at another atlas's texels."""
        row, column = np.divmod(texels.pixel, texels.resolution)
        bare, per_melanin = (
            looked_up(self.texels.as_map(field), row, column, texels.resolution)
            for field in (self.bare, self.per_melanin)
        )
        return AtlasTone(texels, bare, per_melanin, self.melanin)

    @property
    def log_ratio(self) -> np.ndarray:
        """With this melanin."""
        return self.bare + np.float32(self.melanin) * self.per_melanin

    def at(self, pixels: LitPixels) -> PixelTones:
        """Look up the skin that pixels show."""
        fields = (self.texels.as_map(field) for field in (self.bare, self.per_melanin))
        return PixelTones(pixels, *(field[self._texel(pixels)] for field in fields))

    def ratios_at(self, each: Sequence[LitPixels]) -> list[np.ndarray]:
        """Look up the ratio [P, 3], with this melanin, of the skin that each picture's pixels show."""
        ratio = np.exp(self.texels.as_map(self.log_ratio))
        return [ratio[self._texel(pixels)] for pixels in each]

    def _texel(self, pixels: LitPixels) -> tuple[np.ndarray, np.ndarray]:
        size = self.texels.resolution
        column, row = (pixels.uv * size).astype(int).clip(0, size - 1).T
        return row, column


def looked_up(image: np.ndarray, row: np.ndarray, column: np.ndarray, resolution: int) -> np.ndarray:
    """Look a square map up at the texels of an atlas of another resolution."""
    return image[row * len(image) // resolution, column * len(image) // resolution]
