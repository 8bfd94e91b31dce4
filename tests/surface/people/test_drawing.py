"""What is stored of a drawn person: arrays that surfaces take, bands, and a ratio that brings the albedo."""

import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.surface.albedo_ratio import RATIO_ARRAY, RATIO_STEP
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.backend.surface.base_surface import HAIR_FILE, SURFACE_FILE, base_arrays
from livehand.backend.surface.detail_maps_file import NAIL_STEP
from livehand.backend.surface.people.drawing import AtlasSizes, drawn_person
from livehand.backend.surface.people.drawn_forms import drawn_padding_mm, rounded_valleys_mm
from livehand.backend.surface.people.drawn_relief import nail_shape
from livehand.backend.surface.people.drawn_surface import albedo_ratio_arrays
from livehand.backend.surface.people.hand_chart import HandChart
from livehand.backend.surface.people.look import PersonLook
from livehand.backend.surface.stored_surface import check_arrays

pytestmark = pytest.mark.slow

SIZES = AtlasSizes(fine=512, ratio=256)


@pytest.fixture(scope="module")
def drawn():
    look = PersonLook.of(7, {"age": 35.0, "tone": 0.1})
    return drawn_person(load_default_hand(), look, base_arrays(), SIZES)


def test_surfaces_take_the_arrays(drawn):
    ratio = albedo_ratio_arrays(drawn.log_albedo, np.full((64, 64, 3), 0.3, np.float32))
    check_arrays({**drawn.arrays, **ratio}, "it", 4, is_whole=False)
    assert drawn.arrays["fine/relief"].shape == (512, 512)
    assert drawn.arrays["coarse/relief"].shape == drawn.arrays["nail"].shape == (128, 128)


def test_what_is_drawn_is_there(drawn):
    for name in ("fine/relief", "coarse/relief", "fine/dorsal", "coarse/palmar", "vein", "nail"):
        assert np.abs(drawn.arrays[name].astype(int)).max() > 20, name
    assert np.array_equal(drawn.arrays["fine/pigment_light"], drawn.arrays["fine/pigment_deep"])
    assert "coarse/pigment_light" not in drawn.arrays  # what the base's own rays pass over


def test_fine_maps_have_no_mean_and_go_on_beside_the_skin(drawn, texels):
    """Else there would be a step in relief, which shines, wherever two charts meet."""
    fine = drawn.arrays["fine/relief"].astype(float)
    skin = texels.from_map(fine)
    assert np.array_equal(fine, texels.as_map(skin)[..., 0])
    assert abs(skin.mean()) < 0.1 * skin.std()


def test_slopes_of_the_bases_valleys_are_not_left_where_a_person_has_them_filled(drawn, template):
    """They were facets; others, as those of nails' rims, stay."""
    base, found = base_arrays()["unresolved"], drawn.arrays["unresolved"]
    chart = HandChart.at_vertices(template)
    flesh_mm = drawn_padding_mm(chart, PersonLook.of(7, {"age": 35.0, "tone": 0.1}))
    filled_mm = rounded_valleys_mm(template, chart, flesh_mm) - flesh_mm
    texels = AtlasTexels.of(template.corner_uv, template.faces, base.shape[-1])
    lowest, highest = (way(filled_mm[texels.corners], axis=1) for way in (np.min, np.max))
    for before, after in zip(base, found, strict=True):
        of_base, of_person = texels.from_map(before), texels.from_map(after)
        assert np.abs(of_base[lowest > 0.5]).max() > 20
        np.testing.assert_array_equal(of_person[lowest > 0.5], 0)
        np.testing.assert_array_equal(of_person[highest < 0.1], of_base[highest < 0.1])
    assert (lowest > 0.5).sum() > 100
    assert (highest < 0.1).mean() > 0.9


def test_nails_do_not_fade_where_charts_meet(drawn, chart, texels):
    row, column = np.divmod(texels.pixel, 512)
    block = (row // 4) * 128 + column // 4
    count, outermost = np.bincount(block, minlength=128**2), np.zeros(128**2)
    np.maximum.at(outermost, block, nail_shape(chart).rim)
    on_border = (count > 0) & (count < 16) & (outermost < 0.85)
    assert on_border.any()
    assert (drawn.arrays["nail"].ravel()[on_border] * NAIL_STEP > 0.95).all()


def test_the_ratio_times_the_networks_colour_is_the_drawn_one():
    random = np.random.default_rng(1)
    wanted = np.log(random.uniform(0.1, 0.6, (128, 128, 3))).astype(np.float32)
    networks = np.full((64, 64, 3), 0.25, np.float32)
    steps = albedo_ratio_arrays(wanted, networks)[RATIO_ARRAY].astype(float)
    np.testing.assert_allclose(np.exp(steps * RATIO_STEP) * 0.25, np.exp(wanted), rtol=RATIO_STEP)


def test_hair_is_where_it_was_but_not_as_dense(drawn):
    base = base_arrays(HAIR_FILE)["hair/share"]
    share = drawn.arrays["hair/share"]
    assert share[base == 0].max() == 0
    assert 0.5 * base.mean() < share.mean() < base.mean()


def test_the_bases_forms_stay_and_the_persons_own_follow(drawn):
    base = base_arrays(SURFACE_FILE)
    for name in ("form/joint", "form/range_deg", "form/height"):
        own = drawn.arrays[name]
        assert own.dtype == base[name].dtype
        assert len(own) > len(base[name])
        assert np.array_equal(own[: len(base[name])], base[name])
