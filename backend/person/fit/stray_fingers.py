"""Fingers that a fit has bent the wrong way: where the film's is straight, and has the same outline.

Flow finds nothing alike there and outlines agree, so that no step of the fit leads back. But such a finger shows other
skin than the picture does: its colours miss the picture's by five times as much as in other pictures, where those of a
good finger hardly miss twice as much. It gets the bend that it has in a picture near by, if that looks better, and the
next fit goes on from there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...hand.model import HandModel
from ...records.hand_picture import UNKNOWN, HandPicture
from ...system.parallel_map import parallel_map
from ..lit_model.flow import nearest
from ..lit_model.illumination import Illumination, encoded_colours
from ..lit_model.model import PersonModel
from ..lit_model.picture_lights import PictureIlluminations
from .pose_targets import visible_vertices
from .refit import made_smaller

_FINGERS = 5
_LONGEST_PX = 300
_FEWEST_VERTICES = 6  # of a finger, that tell of it
_FEWEST_PICTURES = 5  # that tell what is usual
_STRAY, _BETTER = 3.5, 0.7  # by which a stray finger misses more than usual, and a better one less than it did
_LEAST_USUAL = 0.02  # encoded; noise
_NEAR = 3  # pictures before and after, whose bend is tried


def without_stray_fingers(
    model: PersonModel, pictures: Sequence[HandPicture], lights: PictureIlluminations
) -> tuple[tuple[HandPicture, ...], int]:
    """Bend stray fingers as pictures near by have them; returns the pictures, and how many were mended.

    Args:
        model: with about the person's skin.
        pictures: in the order in which they were taken, with fitted poses.
        lights: of every picture.
    """
    missed = np.array(parallel_map(lambda one: finger_misses(model, one, lights.at(one)), pictures))
    suffices = np.isfinite(missed).sum(0) >= _FEWEST_PICTURES
    usual = np.array(
        [np.nanmedian(each) if enough else np.inf for each, enough in zip(missed.T, suffices, strict=True)]
    )
    is_alone = np.array([picture.moment is None for picture in pictures])  # no other picture shares its pose
    is_stray = is_alone[:, None] & (np.nan_to_num(missed) > _STRAY * np.maximum(usual, _LEAST_USUAL))
    mended = list(pictures)
    for index in np.flatnonzero(is_stray.any(1)).tolist():
        near = [pictures[other] for other in _near(index, len(pictures)) if not is_stray[other][is_stray[index]].any()]
        mended[index] = _best(model, pictures[index], near, is_stray[index], lights.at(pictures[index]))
    return tuple(mended), sum(new is not old for new, old in zip(mended, pictures, strict=True))


def finger_misses(model: PersonModel, picture: HandPicture, light: Illumination) -> np.ndarray:
    """Measure by how much the colours at each finger's vertices [5] miss the picture's, encoded.

    NaN of a finger that is hidden, by the hand or by what is labelled unknown.
    """
    small = made_smaller(picture, _LONGEST_PX)
    frame, seen = model.rendered(small.pose, small.camera, light.light), model.seen(small.pose, small.camera)
    straight = frame.rgb / np.maximum(frame.alpha[..., None], 1e-3) * light.tint.astype(np.float32)
    missed = np.abs(encoded_colours(small, straight) - small.rgb / 255).mean(-1)
    px, depth = small.camera.project(model.vertices(small.pose))
    is_shown = (visible_vertices(seen, px, depth) > 0) & (nearest(small.labels, px) != UNKNOWN)
    finger_of = _finger_of(model.hand)
    found = np.full(_FINGERS, np.nan)
    for finger in range(_FINGERS):
        column, row = np.floor(px[is_shown & (finger_of == finger)]).astype(int).T
        if len(row) >= _FEWEST_VERTICES:
            found[finger] = missed[row, column].mean()
    return found


def _finger_of(hand: HandModel) -> np.ndarray:
    """Return the finger [V] to whose joints each vertex belongs most, in their order; -1: the palm's and the arm's."""
    return (hand.lbs_weights.argmax(1) + 2) // 3 - 1


def _near(index: int, count: int) -> list[int]:
    around = [index + sign * step for step in range(1, _NEAR + 1) for sign in (-1, 1)]
    return [other for other in around if 0 <= other < count]


def _best(
    model: PersonModel, picture: HandPicture, near: Sequence[HandPicture], is_stray: np.ndarray, light: Illumination
) -> HandPicture:
    """Return the picture with its stray fingers [5] as near ones have them, or as it is, if none is better."""
    tried = [picture, *(_bent_as(picture, other, is_stray) for other in near)]
    misses = np.array(parallel_map(lambda one: np.nanmean(finger_misses(model, one, light)[is_stray]), tried))
    best = int(np.nanargmin(misses))
    return tried[best] if misses[best] < _BETTER * misses[0] else picture


def _bent_as(picture: HandPicture, other: HandPicture, is_stray: np.ndarray) -> HandPicture:
    joints = np.concatenate([[False], np.repeat(is_stray, 3)])
    theta = np.where(joints[:, None], other.pose.theta, picture.pose.theta)
    return replace(picture, pose=replace(picture.pose, theta=theta))
