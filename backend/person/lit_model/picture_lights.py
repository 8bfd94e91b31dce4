"""The light of every picture: its scene's, or its own where light changes with the place of the hand.

A lamp or a window is far, but a table is near: over a white one fingers are lit from below, over a black mat they are
not, and whoever films throws a shadow. Such pictures have lights of their own, near that of their scene and as strong.
Where light rests a light of its own would explain skin away, a palm that is paler than the back, or a finger that is
redder. So a scene's light moves only if its pictures' own lights explain them all together much better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ...records.hand_picture import HandPicture
from ...records.light import Light
from .illumination import Illumination, LitPixels, LitStrengths, error_of, fitted_light, lit_pixels
from .model import PersonModel

_LEAST_PIXELS = 200
_MOVES = 0.85  # error that own lights leave over what the scene's leaves, below which light moves
_Key = tuple[int, str]
PixelsOfEach = Mapping[_Key, LitPixels]
"""Pixels of pictures, by scene and name."""


@dataclass(frozen=True)
class PictureIlluminations:
    """The light of every picture.

    Attributes:
        of_scene: by scene.
        of_picture: by scene and name, of pictures that have one of their own.
    """

    of_scene: Mapping[int, Illumination]
    of_picture: Mapping[_Key, Illumination] = field(default_factory=dict)

    def at(self, picture: HandPicture) -> Illumination:
        """Return the light of a picture."""
        return self.of_picture.get(_key(picture), self.of_scene[picture.scene])

    def stronger(self, log_gain: float, tint: np.ndarray) -> PictureIlluminations:
        """Return the lights, all so much stronger, with another tint [3]."""
        of_scene = {scene: light.stronger(log_gain, tint) for scene, light in self.of_scene.items()}
        of_picture = {key: light.stronger(log_gain, tint) for key, light in self.of_picture.items()}
        return PictureIlluminations(of_scene, of_picture)


def pixels_of_each(
    model: PersonModel, pictures: Sequence[HandPicture], of_scenes: Mapping[int, LitPixels]
) -> PixelsOfEach:
    """Render every picture in the light of every source of its scene, if the scene has others to compare it with.

    Args:
        model: that rendered the scenes' pixels.
        pictures: of all scenes.
        of_scenes: pixels of some of the pictures, which are not rendered again.
    """
    known = {_key(one.parts[0].picture): one for of_scene in of_scenes.values() for one in of_scene.by_picture()}
    for scene, of_scene in of_scenes.items():
        more = [one for one in pictures if one.scene == scene and _key(one) not in known]
        if len(more) + len(of_scene.parts) < 2:
            known = {key: one for key, one in known.items() if key[0] != scene}
        elif more:
            lamps: list[Light] = [source for source in of_scene.sources if source.lamps]
            rendered = lit_pixels(model, more).with_sources(model, lamps)
            known |= {_key(one.parts[0].picture): one for one in rendered.by_picture()}
    return {key: one for key, one in known.items() if len(one.shown) >= _LEAST_PIXELS}


def fitted_lights(
    scenes: Mapping[int, LitPixels],
    of_scene: Mapping[int, LitStrengths],
    each: PixelsOfEach,
    ratios_at: Callable[[Sequence[LitPixels]], Sequence[np.ndarray]],
) -> PictureIlluminations:
    """Fit the light of each picture, near that of its scene, of scenes whose light moves.

    Args:
        scenes: pixels of every scene.
        of_scene: the light that was fitted to them.
        each: pixels of every picture (`pixels_of_each`).
        ratios_at: returns the ratio [P, 3] of the skin that pixels show, as `fitted_light` takes it.
    """
    lights = {scene: Illumination.of(fit, scenes[scene].sources) for scene, fit in of_scene.items()}
    own = {}
    for scene, near in of_scene.items():
        found = {key: pixels for key, pixels in each.items() if key[0] == scene}
        rows = list(zip(found.values(), ratios_at(list(found.values())), strict=True))
        fits = [fitted_light(pixels, ratio, near) for pixels, ratio in rows]
        left = sum(error_of(fit, *row) for fit, row in zip(fits, rows, strict=True))
        if left < _MOVES * sum(error_of(near, *row) for row in rows):
            lit = (Illumination.of(fit, pixels.sources) for fit, (pixels, _) in zip(fits, rows, strict=True))
            own |= dict(zip(found, lit, strict=True))
    return PictureIlluminations(lights, own)


def _key(picture: HandPicture) -> _Key:
    return picture.scene, picture.name
