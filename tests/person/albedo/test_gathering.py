"""What is gathered of a picture is what its pixels see of the atlas."""

import numpy as np
import pytest
from livehand.backend.person.albedo.gathering import gathered_ratio
from livehand.backend.person.lit_model.illumination import Illumination, lobe_directions
from livehand.backend.person.lit_model.picture_lights import PictureIlluminations
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.tests.person.conftest import middle_person, pictured
from scipy.ndimage import binary_erosion

pytestmark = pytest.mark.slow
ATLAS_PX, INNER_PX = 256, 3
FACING = 0.5  # of pixels that show their texels well


@pytest.fixture(scope="module")
def gathered():
    """A picture, what it shows of the person, the atlas's texels, and what was gathered there."""
    model = middle_person()
    light = Illumination(np.full(len(lobe_directions()), 0.1), np.ones(3))
    picture = pictured(model, light.light, 1).pictures[0]
    template = model.template
    texels = AtlasTexels.of(template.corner_uv, template.faces, ATLAS_PX)
    found = gathered_ratio(model, texels, [picture], PictureIlluminations({0: light}), None, with_flow=False)
    return model.seen(picture.pose, picture.camera), texels, found


def test_texels_that_pixels_show_count(gathered):
    seen, texels, found = gathered
    weight = np.zeros(ATLAS_PX**2)
    weight[texels.pixel] = found.weight
    inner = binary_erosion(seen.is_seen, iterations=INNER_PX) & (seen.facing > FACING)
    column, row = (seen.uv[inner] * ATLAS_PX).astype(int).T
    assert inner.sum() > 1000
    assert (weight[row * ATLAS_PX + column] > 0).mean() > 0.9  # the rest lies at edges of depth


def test_texels_that_count_are_shown_and_have_the_persons_own_colour(gathered):
    seen, texels, found = gathered
    counts = found.weight > 0
    shown = np.zeros((ATLAS_PX, ATLAS_PX), bool)
    column, row = (seen.uv[seen.is_seen] * ATLAS_PX).astype(int).T
    shown[row, column] = True
    around = ~binary_erosion(~shown, np.ones((3, 3)), iterations=2, border_value=1)
    assert around.ravel()[texels.pixel[counts]].mean() > 0.99
    assert np.abs(found.mean[counts]).mean() < 0.03
