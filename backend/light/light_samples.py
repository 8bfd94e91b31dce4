"""Samples of a frame's light: directions of the sky, and points of every lamp."""

from __future__ import annotations

from typing import NamedTuple

from jaxtyping import Float
from torch import Tensor

from ..records.light import Light
from .lamp_samples import LampSamples
from .shadow_maps import Bounds
from .sky_samples import SkySamples, division_of


class LightSamples(NamedTuple):
    """The light of a frame, sampled."""

    sky: SkySamples
    lamps: LampSamples

    @classmethod
    def of(cls, light: Light, bounds: Bounds) -> LightSamples:
        """The samples around a hand."""
        sky = SkySamples.of(light.sky, bounds.centre.device, division_of((light.sky,), light.penumbra))
        return cls(sky, LampSamples.of(light.lamps, bounds, light.penumbra))

    def unblocked(self, point: Float[Tensor, " 3"]) -> Float[Tensor, ""]:
        """What all of the light together would make of a white surface that faced all of it, mean over colours."""
        _, strength = self.lamps.arriving(point[None])
        of_lamps = (strength * self.lamps.rgb[self.lamps.lamp]).sum(0)
        return (self.sky.flux.sum(0) + of_lamps).mean()
