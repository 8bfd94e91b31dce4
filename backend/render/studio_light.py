"""A photographer's light for a hand that is rendered without a scene."""

from __future__ import annotations

import numpy as np

from ..records.light import Lamp, Light, Sky, rotation_facing

_KEY_W, _KEY_M, _KEY_SIZE_M = 7.0, 0.9, 0.25
_SKY = 0.12  # radiance


def studio_light() -> Light:
    """Make a key lamp from the upper left of a camera that looks along +Y at the origin, and a dim sky."""
    towards = np.array([-0.75, -0.5, 0.6])
    towards /= np.linalg.norm(towards)
    size_m = (_KEY_SIZE_M, _KEY_SIZE_M)
    key = Lamp("area", np.full(3, _KEY_W), _KEY_M * towards, rotation_facing(towards), size_m=size_m)
    return Light((key,), Sky(np.full((2, 4, 3), _SKY)), shadow_quality="fine")
