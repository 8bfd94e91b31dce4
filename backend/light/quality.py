"""How finely the light on a hand is sampled: less finely in previews."""

from __future__ import annotations

from typing import NamedTuple

from .bounce import MOST_PROBES
from .sky_samples import SKY_DIRECTIONS


class LightQuality(NamedTuple):
    """Of the light on a hand.

    Attributes:
        sky_directions: along which shadows of the sky are looked for; of fewer than the sky's cells, each cell has the
            nearest one's.
        probes: discs of skin that shed light on the rest, at most.
    """

    sky_directions: int
    probes: int


FINAL = LightQuality(SKY_DIRECTIONS, MOST_PROBES)
PREVIEW = LightQuality(16, 480)
"""Pictures differ from those of `FINAL` by 39 to 50 dB on the hand for the sky, and by 48 to 54 for the probes."""
