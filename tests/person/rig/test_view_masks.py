"""Skin in a picture is found, and given to the hand whose it is."""

import numpy as np
import pytest
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.person.rig.view_masks import (
    ARM,
    FREE,
    LEFT,
    RIGHT,
    hand_labels,
    overlap,
    relabelled,
    skin_likelihood,
    view_labels,
)
from livehand.backend.records.hand_picture import BACKGROUND, HAND, UNKNOWN
from livehand.backend.records.shot import HandPose

pytestmark = pytest.mark.slow

SCALE = 0.85  # px in a millimetre


def moved(rig, by):
    """The vertices of hands that are not quite where the pictures show them."""
    poses = [HandPose(p.theta, p.beta, p.transl + by, p.side, p.forearm) for p in rig.poses.values()]
    return np.concatenate([posed_arrays(rig.model, pose)[0] for pose in poses])


@pytest.mark.parametrize("row", [1, 3])
def test_skin_is_found_by_its_colours_though_the_mesh_is_off(made_rig, row):
    view, truth = made_rig.views()[row], made_rig.labels()[row]
    meshes = moved(made_rig, (0.004, 0.0, 0.003))
    labels = view_labels(view.rgb, meshes, made_rig.hands, view.camera, SCALE)
    found, skin = labels > FREE, truth > FREE
    assert (found & skin).sum() / (found | skin).sum() > 0.96
    hand = np.isin(truth, (RIGHT, LEFT))
    assert (labels[hand] == truth[hand]).mean() > 0.93


def test_a_hand_that_is_not_in_the_picture_leaves_it_free(made_rig):
    view = made_rig.views()[0]
    labels = view_labels(view.rgb, made_rig.vertices + np.array([0, 0, 5.0]), made_rig.hands, view.camera, SCALE)
    assert (labels == FREE).all()


def test_likelihood_follows_the_picture_s_own_colours():
    rgb = np.zeros((20, 20, 3), np.uint8)
    rgb[:, :10], rgb[:, 10:] = (200, 150, 120), (30, 60, 90)
    skin = np.zeros((20, 20), bool)
    skin[5:15, 2:6] = True
    likelihood = skin_likelihood(rgb, skin, np.roll(skin, 12, 1))
    assert likelihood[:, :10].min() > 0.95
    assert likelihood[:, 10:].max() < 0.05


def test_what_is_the_other_s_and_its_border_are_unknown():
    labels = np.zeros((30, 40), np.uint8)
    labels[5:25, 5:20], labels[5:25, 20:30], labels[5:25, 30:35] = RIGHT, LEFT, ARM
    own = hand_labels(labels, "right", labels, 1.0)
    assert (own[10, 5:18] == HAND).all()
    assert (own[10, 18:37] == UNKNOWN).all()  # from 2 px before the other hand to 2 px behind the arm
    assert (own[10, 37:] == BACKGROUND).all()
    other = hand_labels(labels, "left", labels, 1.0)
    assert set(other[10, 22:28].tolist()) == {HAND}
    assert set(other[10, 5:22].tolist()) == {UNKNOWN}


def test_where_the_mesh_is_the_other_s_nothing_is_known_though_no_skin_was_found():
    labels, mesh = np.zeros((10, 10), np.uint8), np.full((10, 10), LEFT, np.uint8)
    assert (hand_labels(labels, "right", mesh, 1.0) == UNKNOWN).all()


def test_skin_goes_to_the_nearest_mesh_of_a_later_fit():
    labels = np.full((4, 10), RIGHT, np.uint8)
    labels[:, 9] = FREE
    mesh = np.zeros((4, 10), np.uint8)
    mesh[:, 1:3], mesh[:, 6:8] = RIGHT, LEFT
    assert relabelled(labels, mesh)[0].tolist() == [RIGHT] * 5 + [LEFT] * 4 + [FREE]
    assert np.array_equal(relabelled(labels, np.zeros_like(mesh)), labels)


def test_overlap_is_intersection_over_union_away_from_arms():
    labels, mesh = np.zeros((40, 40), np.uint8), np.zeros((40, 40), np.uint8)
    labels[:20], mesh[5:25] = LEFT, LEFT
    assert overlap(labels, mesh, "left") == pytest.approx(15 / 25)
    assert np.isnan(overlap(labels, mesh, "right"))
    mesh[30:] = ARM
    assert overlap(labels, mesh, "left") == pytest.approx(15 / 25)
    assert overlap(labels, mesh, "left", arm_px=10) == pytest.approx(15 / 20)
