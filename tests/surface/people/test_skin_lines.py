"""Creases and veins: continuous, branched, of one's own, and where hands have them."""

import numpy as np
import pytest
from livehand.backend.surface.people.skin_lines import palm_creases, plane, veins
from scipy.ndimage import label


@pytest.fixture(scope="module")
def creases():
    return [palm_creases(np.random.default_rng(seed), 20) for seed in (1, 2)]


def sample(image, d, r):
    """At (d, r) of the plane."""
    return float(image.at(np.float32([[95 - d, 0, r]]))[0])


def test_points_of_the_template_lie_in_the_plane():
    np.testing.assert_allclose(plane(np.array([[95.0, 5, 3], [5, 5, -3]])), [[0, 3], [90, -3]])


def test_main_creases_are_long_and_have_no_gaps(creases):
    for image in creases:
        pieces = np.zeros(image.values.shape, np.int32)
        count = int(np.asarray(label(image.values > 0.35, output=pieces)))
        spans_mm = []
        for piece in range(1, count + 1):
            rows, columns = (pieces == piece).nonzero()
            spans_mm.append(image.texel_mm * np.hypot(np.ptp(rows), np.ptp(columns)))
        assert sum(span > 38 for span in spans_mm) >= 3
        assert max(spans_mm) > 45


def test_two_people_share_no_crease(creases):
    images = [*creases, palm_creases(np.random.default_rng(3), 20)]
    shared = np.corrcoef([image.values.ravel() for image in images])
    assert np.abs(shared - np.eye(3)).max() < 0.2


def test_veins_run_along_the_back_and_differ(creases):
    first, second = (veins(np.random.default_rng(seed)) for seed in (1, 2))
    for image in (first, second):
        for d in (-100, -40, 40):
            assert max(sample(image, d, r) for r in np.arange(-40, 40, 0.5)) > 0.5
    off = [image.values - image.values.mean() for image in (first, second)]
    assert (off[0] * off[1]).mean() / (off[0].std() * off[1].std()) < 0.5


def test_nothing_is_drawn_beside_the_image(creases):
    assert sample(creases[0], 500, 0) == 0
