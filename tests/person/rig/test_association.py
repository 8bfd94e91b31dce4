"""Finds of all pictures, in any order and with false ones among them, become the two hands."""

from typing import NamedTuple

import numpy as np
import pytest
from livehand.backend.person.rig import association
from livehand.backend.person.rig.association import Find, associated_hands, found_hands, with_second_look
from livehand.backend.records.errors import LiveHandError
from livehand.backend.tracking.tflite import Network
from livehand.backend.tracking.weights import TrackerNetworks

pytestmark = pytest.mark.slow


@pytest.fixture
def finds(made_rig):
    """Both hands' finds with noise, two views without one of them, false finds and wrong sides, shuffled."""
    rng = np.random.default_rng(4)
    own = [find for hand in made_rig.found(1.0) for find in hand.finds]
    own = [find for index, find in enumerate(own) if index not in (1, 13)]
    own[4] = own[4]._replace(right=0.0)
    own += [Find(row, rng.uniform(20, 280, (21, 2)), 1.0) for row in (0, 1, 3)]
    return [own[index] for index in rng.permutation(len(own))]


def test_both_hands_are_found_with_all_their_views(made_rig, finds):
    hands = associated_hands(finds, made_rig.cameras, made_rig.model)
    assert set(hands) == {"right", "left"}
    assert hands["right"].views == [0, 2, 3, 4, 5, 6, 7]
    assert hands["left"].views == [0, 1, 2, 3, 4, 6, 7]
    for side, points in zip(made_rig.poses, made_rig.points, strict=True):
        assert np.linalg.norm(hands[side].points - points, axis=1).max() < 6e-3


def test_finds_that_do_not_agree_are_refused(made_rig):
    rng = np.random.default_rng(0)
    finds = [Find(row, rng.uniform(20, 280, (21, 2)), 1.0) for row in range(4)]
    with pytest.raises(LiveHandError, match="at least 3 cameras that agree, got finds in 4 of 8"):
        associated_hands(finds, made_rig.cameras, made_rig.model)


class Look(NamedTuple):
    """What the tracker tells of a region."""

    px: np.ndarray
    right: float
    presence: float


class Tracker:
    """Finds the right hand's landmarks wherever it looks; only those of views 1 and 5 are there."""

    presence = 1.0
    places: tuple = ()

    def __init__(self, networks, most_hands=1):
        pass

    def track(self, rgb):
        return []

    def look(self, rgb, region):
        return Look(self.places[int(rgb[0, 0, 0])], 1.0, self.presence)


def test_a_second_look_finds_hands_where_they_must_be(made_rig, finds, monkeypatch):
    hands = associated_hands(finds, made_rig.cameras, made_rig.model)
    views = [view.__class__(view.name, np.full((4, 4, 3), row, np.uint8), view.camera, view.camera_index)
             for row, view in enumerate(made_rig.views())]  # fmt: skip
    monkeypatch.setattr(association, "HandTracker", Tracker)
    monkeypatch.setattr(Tracker, "places", [camera.project(made_rig.points[0])[0] for camera in made_rig.cameras])
    networks = TrackerNetworks(Network.__new__(Network), Network.__new__(Network))
    completed = with_second_look(hands, views, networks)
    assert completed["right"].views == list(range(8))
    assert completed["left"].views == hands["left"].views  # what is found there is the right hand
    monkeypatch.setattr(Tracker, "presence", 0.1)
    assert with_second_look(hands, views, networks)["right"].views == hands["right"].views
    assert found_hands(views, networks) == []
