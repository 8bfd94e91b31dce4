"""Samples of the light of a frame: directions of the sky and points of every lamp, and how many."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from ..records.light import Light
from .indirect_diffuse import MOST_SURFELS
from .lamp_samples import LampSamples
from .shadow_maps import Bounds
from .sky_samples import SKY_DIRECTIONS, SkySamples, division_of


class LightSamples(NamedTuple):
    """The light of a frame, sampled."""

    sky: SkySamples
    lamps: LampSamples

    @classmethod
    def of(cls, light: Light, bounds: Bounds) -> LightSamples:
        """Sample a light around a hand."""
        sky = SkySamples.of(light.sky, bounds.centre.device, division_of((light.sky,), light.shadow_quality))
        return cls(sky, LampSamples.of(light.lamps, bounds, light.shadow_quality))

    def unblocked(self, point: Float[Tensor, " 3"]) -> Float[Tensor, ""]:
        """Compute the radiance of a white surface at the point, facing all light unblocked, mean over colours."""
        _, strength = self.lamps.arriving(point[None])
        of_lamps = (strength * self.lamps.rgb[self.lamps.lamp]).sum(0)
        return (self.sky.flux.sum(0) + of_lamps).mean()


class LightQuality(NamedTuple):
    """Of the light on a hand.

    Attributes:
        sky_directions: along which shadows of the sky are looked for; of fewer than the sky's cells, each cell has the
            nearest one's.
        surfels: of the skin for indirect diffuse light, at most.
    """

    sky_directions: int
    surfels: int


FINAL = LightQuality(SKY_DIRECTIONS, MOST_SURFELS)
PREVIEW = LightQuality(16, 480)
"""Pictures differ from those of `FINAL` by 39 to 50 dB on the hand for the sky, and by 48 to 54 for the surfels."""
