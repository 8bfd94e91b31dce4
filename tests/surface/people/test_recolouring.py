"""Drawn colours on the base's relief: they are drawn whatever the networks show, and lie where the base's forms do."""

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.surface.albedo_ratio import RATIO_ARRAY, RATIO_STEP
from livehand.backend.surface.base_surface import COARSE_FILE, base_arrays
from livehand.backend.surface.people.look import PersonLook
from livehand.backend.surface.people.recolouring import recoloured_arrays
from livehand.tests.surface.people.conftest import RESOLUTION

pytestmark = pytest.mark.slow
LOOK = PersonLook.of(7, {"tone": 0.3, "age": 40.0, "blood": 1.0})


def log_albedo(texels, look, network_albedo):
    steps = recoloured_arrays(load_default_hand(), look, network_albedo, RESOLUTION)[RATIO_ARRAY]
    shown = np.log(network_albedo)[0, 0]
    return texels.from_map(steps * np.float32(RATIO_STEP)) + shown


def even(colour):
    return np.full((8, 8, 3), colour, np.float32)


@pytest.fixture(scope="module")
def drawn(texels):
    return log_albedo(texels, LOOK, even((0.4, 0.3, 0.2)))


def test_what_is_seen_does_not_depend_on_what_networks_show(texels, drawn):
    other = log_albedo(texels, LOOK, even((0.5, 0.25, 0.2)))
    np.testing.assert_allclose(other, drawn, atol=RATIO_STEP)


def test_seeds_differ(texels, chart, drawn):
    other = log_albedo(texels, PersonLook.of(8, {"tone": 0.3, "age": 40.0, "blood": 1.0}), even((0.4, 0.3, 0.2)))
    assert np.abs(other - drawn)[chart.palm < 0.05].mean() > 0.03


def test_creases_and_nails_are_the_bases(texels, chart, drawn):
    """Where the base's palm is creased it is darker than beside, and its plates are paler than the skin around them."""
    steps = base_arrays(COARSE_FILE)
    size = len(steps["coarse/palmar"])
    row, column = (at * size // RESOLUTION for at in np.divmod(texels.pixel, RESOLUTION))
    depth, nail = steps["coarse/palmar"][row, column], steps["nail"][row, column]
    palm = (chart.palm > 0.95) & (chart.on_digit < 0.02)
    assert drawn[palm & (depth > 15)].mean() < drawn[palm & (np.abs(depth) < 3)].mean() - 0.03
    beside = (nail == 0) & (chart.height > 0.7) & (np.abs(chart.nail_along) < 1) & (chart.on_digit > 0.9)
    assert drawn[nail == 100].mean() > drawn[beside].mean() + 0.1
