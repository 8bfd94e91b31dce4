"""What is found of a light that stays while the hand moves, or of a hand and its surroundings while lamps do."""

from __future__ import annotations

from operator import attrgetter
from typing import Any

import numpy as np
from torch import Tensor

from ..records.light import Lamp, Light, ShadowQuality, Sky
from .lamp_samples import LampSamples
from .nearby_geometry import Patches
from .samples import LightSamples
from .shadow_maps import Bounds

_NUMBERS = attrgetter(
    "kind", "radius_m", "angle_rad", "size_m", "is_ellipse", "spread_rad", "cone_rad", "blend", "casts_shadow"
)


class KeptSamples:
    """Samples lights as `LightSamples.of` does; of the last one it keeps what does not depend on the hand.

    Lights are compared by their numbers, as arrays can be written in place.
    """

    def __init__(self) -> None:
        self._sky: Sky | None = None
        self._quality: ShadowQuality | None = None
        self._lamps: tuple[Any, ...] = ()
        self._samples: LightSamples | None = None

    def samples(self, light: Light, bounds: Bounds) -> LightSamples:
        """Sample a light around a hand; what is as in the last one is the same tensors."""
        kept, numbers = self._samples, tuple(_numbers_of(lamp) for lamp in light.lamps)
        if kept is None or light.shadow_quality != self._quality or not _are_equal(light.sky, self._sky):
            made = LightSamples.of(light, bounds)
            self._sky = None if light.sky is None else Sky(np.array(light.sky.radiance))
        else:
            moved = kept.lamps.around(light.lamps, bounds, light.shadow_quality) if numbers == self._lamps else None
            made = kept._replace(lamps=moved or LampSamples.of(light.lamps, bounds, light.shadow_quality))
        self._quality, self._lamps, self._samples = light.shadow_quality, numbers, made
        return made


class KeptPatches:
    """Finds what reflects light onto a hand; for the same hand beside the same geometry once."""

    def __init__(self) -> None:
        self._given: tuple[np.ndarray, ...] = ()
        self._found: Patches | None = None

    def around(self, light: Light, vertices: Tensor) -> Patches | None:
        """Find the patches, as `Patches.around`; None: there are none."""
        if len(light.occluder_albedo) == 0:
            return None
        given = light.occluders, light.occluder_albedo, vertices.numpy()
        if not self._given or not all(map(np.array_equal, given, self._given)):
            found = Patches.around(light, vertices)
            self._given, self._found = tuple(map(np.array, given)), found if len(found.position) else None
        return self._found


def _numbers_of(lamp: Lamp) -> tuple[Any, ...]:
    arrays = (np.asarray(values, np.float64).tobytes() for values in (lamp.rgb, lamp.position, lamp.rotation))
    return *arrays, _NUMBERS(lamp)


def _are_equal(one: Sky | None, other: Sky | None) -> bool:
    if one is None or other is None:
        return one is other
    return np.array_equal(one.radiance, other.radiance)
