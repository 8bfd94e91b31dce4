"""Noise in space: its mean, deviation and wavelength, and cells with their borders."""

import numpy as np
import pytest
from livehand.backend.surface.people.solid_noise import SolidNoise


@pytest.fixture
def noise():
    return SolidNoise.of(np.random.default_rng(1))


def test_smooth_noise_has_mean_0_deviation_1_and_its_wavelength(noise):
    points = np.random.default_rng(2).uniform(0, 200, (40000, 3)).astype(np.float32)
    values = noise.smooth(points, 8.0)
    assert abs(values.mean()) < 0.1
    assert 0.8 < values.std() < 1.25
    near, far = (noise.smooth(points + np.float32([step, 0, 0]), 8.0) for step in (0.4, 12.0))
    assert np.corrcoef(values, near)[0, 1] > 0.9
    assert abs(np.corrcoef(values, far)[0, 1]) < 0.15


def test_smooth_noise_goes_through_its_lattice_which_repeats(noise):
    """Of one octave, the deviation being 0.17 of the lattice's range; waves of 2 mm make cells of a millimetre."""
    cell = np.random.default_rng(4).integers(0, 64, (500, 3))
    wanted = (noise.lattice[tuple(cell.T)] - 0.5) / 0.17
    for turns in (0, 64, -64):
        points = ((cell + turns - noise.start) @ noise.turn.T).astype(np.float32)
        np.testing.assert_allclose(noise.smooth(points, 2.0, 1), wanted, atol=2e-3)


def test_seeds_share_nothing(noise):
    points = np.random.default_rng(2).uniform(0, 60, (20000, 3)).astype(np.float32)
    other = SolidNoise.of(np.random.default_rng(3))
    assert abs(np.corrcoef(noise.smooth(points, 4.0), other.smooth(points, 4.0))[0, 1]) < 0.1


def test_cells_are_as_large_as_asked_and_meet_at_borders(noise):
    along = np.zeros((6000, 3), np.float32)
    along[:, 0] = np.linspace(0, 300, 6000)
    cells = noise.cells(along, (2.0, 2.0, 2.0))
    changes = int((np.diff(cells.chance[:, 0]) != 0).sum())
    assert 100 < changes < 300
    at = np.diff(cells.chance[:, 0]).nonzero()[0]
    assert cells.border[at].max() < 0.1
    assert cells.border.min() >= 0
    assert cells.distance.max() < 1.5
