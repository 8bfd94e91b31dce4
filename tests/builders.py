"""What tests of several folders build: `from livehand.tests.builders import ...`."""

import numpy as np
from livehand.backend.evaluation.evaluate import scored_views
from livehand.backend.hand.joint_limits import FREE
from livehand.backend.motion.landmarks.lifting import LiftedLandmarks


def joints_as_tracked(points, _world, deviation=0.018):
    """The lifting of a tracker that means our joints and fingertips: as they are, with a share of the hand's size."""
    size = np.ptp(points, axis=1).max(-1)
    unknown = np.zeros((len(points), len(FREE)))
    return LiftedLandmarks(points, np.repeat(deviation * size[:, None], 21, 1), unknown, np.full_like(unknown, np.inf))


def scores_of(renderer, capture, views, distances=()):
    """The scores of all views that show the hand."""
    return [scored.score for scored in scored_views(renderer, capture, views, distances)]
