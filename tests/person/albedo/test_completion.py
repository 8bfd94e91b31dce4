"""Skin that no picture shows: it gets the contrast of the rest, and what pictures show stays."""

import numpy as np
import pytest
from livehand.backend.person.albedo.completion import CompletedRatio, with_unseen_detail
from livehand.backend.person.lit_model.numbers import ToneFit
from livehand.backend.surface.atlas_texels import AtlasTexels
from livehand.backend.surface.skin_patches import RestPoints
from livehand.tests.person.conftest import middle_person

pytestmark = pytest.mark.slow
BACK_TO = -0.03  # m along the hand at rest, where it begins to be unseen


@pytest.fixture(scope="module")
def skin():
    base = middle_person()
    texels = AtlasTexels.of(base.template.corner_uv, base.template.faces, 256)
    at_rest = texels.at_texels(base.at_detail(base.hand.v_template))
    return texels, RestPoints(1000 * at_rest, texels.at_texels(base.template.normals.numpy()))


def completed(log_ratio, confidence):
    return CompletedRatio(log_ratio.astype(np.float32), 0 * log_ratio, confidence, ToneFit(0.4, 1, 0, np.zeros(3), 0))


def noise(count, deviation, seed):
    return deviation * np.random.default_rng(seed).normal(size=(count, 1)).astype(np.float32).repeat(3, 1)


@pytest.mark.parametrize(("own", "base"), [(0.2, 0.05), (0.05, 0.08)])
def test_unseen_skin_gets_the_contrast_of_what_is_seen(skin, own, base):
    texels, points = skin
    is_seen = points.position_mm[:, 0] < 1000 * BACK_TO
    base_log_albedo = noise(len(is_seen), base, 1)
    person = noise(len(is_seen), own, 2)
    log_ratio = np.where(is_seen[:, None], person - base_log_albedo, 0)
    none = np.zeros(len(is_seen), bool)
    given = completed(log_ratio, is_seen.astype(np.float32))
    whole = with_unseen_detail(texels, given, base_log_albedo, points, none, none)
    np.testing.assert_allclose(whole.log_ratio[is_seen], log_ratio[is_seen], atol=1e-6)
    shown = (whole.log_ratio + base_log_albedo)[~is_seen]
    assert shown.std() == pytest.approx(own, rel=0.15)


def test_nails_and_marks_are_neither_copied_nor_painted(skin):
    texels, points = skin
    is_seen = points.position_mm[:, 0] < 1000 * BACK_TO
    random = np.random.default_rng(3).random(len(is_seen))
    is_nail, is_mark = random < 0.02, random > 0.98
    log_ratio = noise(len(is_seen), 0.05, 5) * is_seen[:, None]
    sign = np.where(np.random.default_rng(6).random(len(is_seen)) > 0.5, 0.5, -0.5)[:, None]
    log_ratio = np.where((is_seen & (is_nail | is_mark))[:, None], sign, log_ratio)
    given = completed(log_ratio, is_seen.astype(np.float32))
    whole = with_unseen_detail(texels, given, np.zeros_like(log_ratio), points, is_nail, is_mark)
    other = is_nail | is_mark
    np.testing.assert_array_equal(whole.log_ratio[other], log_ratio[other].astype(np.float32))
    unmarked = with_unseen_detail(texels, given, np.zeros_like(log_ratio), points, other, np.zeros_like(other))
    added, more = (one.log_ratio[~is_seen & ~other] for one in (unmarked, whole))
    assert 0.03 < added.std() < 0.08  # nails say nothing of the skin's contrast of .05
    assert more.std() > 1.5 * added.std()  # large spots do


def test_a_person_of_whom_nothing_is_sure_stays(skin):
    texels, points = skin
    given = completed(noise(len(texels.pixel), 0.1, 4), np.full(len(texels.pixel), 0.4, np.float32))
    assert with_unseen_detail(texels, given, given.prior, points, *np.zeros((2, len(texels.pixel)), bool)) is given
