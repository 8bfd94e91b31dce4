"""What the tests of invented people share: the built-in hand's chart at the texels of a small atlas, and two people."""

from typing import NamedTuple

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.backend.surface.detail_mesh import DetailTemplate
from livehand.backend.surface.detail_surface import load_detail_surface
from livehand.backend.surface.people.drawn_albedo import drawn_log_albedo
from livehand.backend.surface.people.drawn_relief import DrawnRelief, drawn_relief
from livehand.backend.surface.people.hand_chart import HandChart
from livehand.backend.surface.people.look import PersonLook
from livehand.backend.surface.people.skin_lines import veins

RESOLUTION = 512


class Drawn(NamedTuple):
    look: PersonLook
    relief: DrawnRelief
    log_albedo: np.ndarray


@pytest.fixture(scope="session")
def template():
    hand = load_default_hand()
    return DetailTemplate.of(load_detail_surface(hand.sha256), hand)


@pytest.fixture(scope="session")
def texels(template):
    return AtlasTexels.of(template.corner_uv, template.faces, RESOLUTION)


@pytest.fixture(scope="session")
def chart(template, texels):
    return HandChart.at_texels(template, texels)


@pytest.fixture(scope="session")
def people(chart):
    """Two people of the same numbers, of two seeds."""
    numbers = {name: 0.5 for name in ("veins", "freckles")} | {"age": 40.0, "tone": 0.1, "blood": 1.0, "folds": 1.0}
    return [drawn(chart, PersonLook.of(seed, numbers)) for seed in (1, 2)]


def drawn(chart, look):
    relief = drawn_relief(chart, look)
    return Drawn(look, relief, drawn_log_albedo(chart, relief, veins(look.random(1)).at(chart.points_mm), look))
