"""One shape for a take: the proportions of the hand's bones are found, its size is left to the prior."""

import numpy as np
import pytest
from livehand.backend.motion.landmarks.skeleton import HandSkeleton
from livehand.backend.tracking.turning_hand.take_shape import fit_with_shape, shape_of
from livehand.tests.builders import joints_as_tracked

pytestmark = pytest.mark.slow

TRUE = np.random.default_rng(3).normal(0, 1, 10)


def off_by(model, beta):
    """Mean relative error of the bones' lengths against one another."""
    lengths = [np.linalg.norm(HandSkeleton.of(model).offsets(each), axis=-1) for each in (beta, TRUE)]
    ours, wanted = (each / np.median(each) for each in lengths)
    return np.abs(ours - wanted).mean()


@pytest.mark.parametrize("side", ["right", "left"])
def test_the_bones_proportions_are_found_where_the_poses_are_known(turning, side):
    film = turning(side=side, beta=TRUE, draws=False)
    before = off_by(film.model, np.zeros(10))
    assert before > 0.08
    assert off_by(film.model, shape_of(film.fit, film.take, side, film.model, joints_as_tracked)) < 0.3 * before


def test_poses_and_shape_are_found_in_turn(turning):
    """Where fingers do little but turn with the hand, their bend hides much of their length."""
    film = turning(beta=TRUE, draws=False)
    fit = fit_with_shape(film.take, "right", film.model, joints_as_tracked)
    assert off_by(film.model, fit.motion.beta) < 0.92 * off_by(film.model, np.zeros(10))


def test_the_mean_hand_stays_the_mean_hand(turning):
    film = turning(draws=False)
    assert np.linalg.norm(shape_of(film.fit, film.take, "right", film.model, joints_as_tracked)) < 1e-6
