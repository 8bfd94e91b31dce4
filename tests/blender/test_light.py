"""Lamps and worlds of a Blender scene as `Light` records: a white patch in their light is as bright as in Cycles."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

probe = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "light_probe.py")))
TOLERANCE = 0.02
ABOVE, ASIDE = (0, 0, 1), (0.5, -0.3, 0.8)
LAMPS = {
    "sun": ("SUN", 3, ABOVE, {}),
    "sun aslant": ("SUN", 3, ASIDE, {"angle": 0.0093}),
    "wide sun": ("SUN", 3, ASIDE, {"angle": 0.7}),
    "point": ("POINT", 10, ABOVE, {"shadow_soft_size": 0.0}),
    "sphere": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.25}),
    "scaled sphere": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.1, "scale": (3, 3, 3)}),
    "spot inside": ("SPOT", 10, ABOVE, {"spot_size": 1.0, "spot_blend": 0.0, "shadow_soft_size": 0.0}),
    "spot in its blend": ("SPOT", 10, ABOVE, {"spot_size": 0.28, "spot_blend": 1.0, "shadow_soft_size": 0.02}),
    "spot aslant": ("SPOT", 10, ASIDE, {"spot_size": 0.6, "spot_blend": 0.8, "shadow_soft_size": 0.05}),
    "spot scaled": ("SPOT", 10, ABOVE, {"spot_size": 0.3, "shadow_soft_size": 0.0, "scale": (2, 2, 1)}),
    "square": ("AREA", 10, ASIDE, {"size": 0.5}),
    "small square": ("AREA", 10, ABOVE, {"size": 0.02}),
    "rectangle": ("AREA", 10, ASIDE, {"shape": "RECTANGLE", "size": 0.9, "size_y": 0.2}),
    "disk": ("AREA", 10, ASIDE, {"shape": "DISK", "size": 0.6}),
    "ellipse": ("AREA", 10, ASIDE, {"shape": "ELLIPSE", "size": 0.2, "size_y": 0.8}),
    "stretched square": ("AREA", 10, ASIDE, {"size": 0.2, "scale": (3, 1, 2)}),
    "mirrored rectangle": ("AREA", 10, ASIDE, {"shape": "RECTANGLE", "size": 0.9, "size_y": 0.2, "scale": (-1, 1, 1)}),
    "spread": ("AREA", 10, ASIDE, {"size": 0.1, "spread": 1.2}),
    "narrow spread": ("AREA", 10, ABOVE, {"size": 0.3, "spread": 0.3}),
    "colour": ("AREA", 10, ASIDE, {"size": 0.3, "color": (1.0, 0.4, 0.05)}),
    "soft falloff off": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.2, "use_soft_falloff": False}),
}
SINCE_4_5 = {
    "exposure": ("AREA", 10, ASIDE, {"size": 0.3, "exposure": -1.5}),
    "temperature": ("POINT", 10, ASIDE, {"use_temperature": True, "temperature": 3200, "color": (0.5, 1, 1)}),
    "sun's radiance": ("SUN", 3, ASIDE, {"angle": 0.3, "normalize": False}),
    "point's radiance": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.1, "normalize": False}),
    "point without radius": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.0, "normalize": False}),
    "rectangle's radiance": ("AREA", 10, ASIDE, {"size": 0.3, "normalize": False, "scale": (2, 1, 1)}),
    "disk's radiance": ("AREA", 10, ASIDE, {"shape": "DISK", "size": 0.3, "normalize": False}),
}
if bpy.app.version >= (4, 5, 0):
    LAMPS |= SINCE_4_5


@pytest.fixture
def patch(registered):
    return probe.white_patch()


def compare(folder, tolerance=TOLERANCE):
    """Cycles' pixels and those by the record: in the mean, and everywhere by the brightest."""
    cycles, ours = probe.cycles_pixels(folder), probe.expected_pixels(probe.light_now())
    assert cycles.max() > 1e-4
    np.testing.assert_allclose(ours.mean((0, 1)), cycles.mean((0, 1)), rtol=tolerance, atol=1e-3 * cycles.max())
    np.testing.assert_allclose(ours, cycles, atol=3 * tolerance * cycles.max())


@pytest.mark.parametrize("name", LAMPS)
def test_each_kind_of_lamp_is_as_bright_as_in_cycles(patch, tmp_path, name):
    kind, energy, location, settings = LAMPS[name]
    probe.add_lamp(kind, energy, location, **settings)
    compare(tmp_path)
