"""Follows each hand of a recording through its frames, by the labels that the file gives it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...records.errors import LiveHandError
from ...records.side import SIDES, Side
from .picture_camera import is_shifted_picture, looks_like_picture
from .recording import EXAMPLE, Recording
from .sighting import KINDS, Sighting

_FLICKER = 0.2  # share of frames in which the label of one hand may be the wrong one
_FEW = 8  # frames that a note names


class Track(NamedTuple):
    """One hand through a recording.

    Attributes:
        points: [N, 21, 3] in MediaPipe's order, in the file's unit; only frames with the hand.
        frame_indices: [N] increasing from the recording's first frame, 0.
        label: which hand the file says it is; None if it does not.
        is_own: the label is surely the hand's own.
    """

    points: np.ndarray
    frame_indices: np.ndarray
    label: Side | None
    is_own: bool


class Tracks(NamedTuple):
    """The one or two hands of a recording.

    Attributes:
        hands: each with a label of its own if there are two.
        is_mediapipe: the points are MediaPipe's, not WebXR's.
        is_picture: the coordinates are a picture's, not metres.
        is_shifted: they were a picture's, and have been moved or scaled since.
        notes: what the user should know.
        torn: in words, the frames that are not read since they lack landmarks; None: there are none.
    """

    hands: tuple[Track, ...]
    is_mediapipe: bool
    is_picture: bool
    is_shifted: bool
    notes: tuple[str, ...]
    torn: str | None


def follow_hands(recording: Recording) -> Tracks:
    """Follow the hands of a recording in its best coordinates: world landmarks before those of the picture.

    Raises:
        LiveHandError: no frame has a hand, or hands that appear together have no labels.
    """
    torn = [number for number, hands in recording.frames.items() if any(map(_is_torn, hands))]
    frames = {number: [hand for hand in hands if _is_there(hand)] for number, hands in recording.frames.items()}
    kinds = {hand.kind for hands in frames.values() for hand in hands}
    if not kinds:
        raise LiveHandError(f"must have a frame with a hand, got none in {recording.frame_count}; {EXAMPLE}")
    kind = next(one for one in KINDS if one in kinds)
    frames = {number: [hand for hand in hands if hand.kind == kind] for number, hands in frames.items()}
    by_hand, notes = _by_hand(frames)
    first = min(recording.frames)
    tracks = tuple(_track(frames_of_hand, first) for frames_of_hand in by_hand if frames_of_hand)
    every = [hand for hands in frames.values() for hand in hands]
    is_mediapipe = all(hand.is_mediapipe for hand in every)
    all_points = np.concatenate([track.points for track in tracks])
    is_picture = kind == "picture" or (kind == "points" and is_mediapipe and looks_like_picture(all_points))
    is_shifted = kind == "points" and is_mediapipe and not is_picture and _are_shifted(tracks)
    return Tracks(tracks, is_mediapipe, is_picture, is_shifted, notes, _torn_words(torn))


def _are_shifted(tracks: tuple[Track, ...]) -> bool:
    return all(is_shifted_picture(track.points) for track in tracks)


def _is_there(hand: Sighting) -> bool:
    if np.isinf(hand.points).any():
        raise LiveHandError("landmarks must be finite, got infinity; track the hand again")
    return bool(np.isfinite(hand.points).all()) and bool(np.ptp(hand.points, axis=0).any())


def _is_torn(hand: Sighting) -> bool:
    """Tell whether some of the landmarks have no numbers; where none has, there is no hand."""
    is_known = np.isfinite(hand.points).all(1)
    return bool(is_known.any() and not is_known.all())


def _torn_words(torn: Sequence[int]) -> str | None:
    if not torn:
        return None
    some = ", ".join(map(str, torn[:_FEW])) + (", ..." if len(torn) > _FEW else "")
    return f"{len(torn)} frames lack some landmarks (NaN) and count as frames without a hand: {some}"


def _by_hand(frames: Mapping[int, list[Sighting]]) -> tuple[list[dict[int, Sighting]], tuple[str, ...]]:
    """Collect the frames of each hand, and notes."""
    crowded = [number for number, hands in frames.items() if len(hands) > 1]
    if not crowded:
        return _of_single_hands({number: hands[0] for number, hands in frames.items() if hands})
    if any(hand.label is None for number in crowded for hand in frames[number]):
        raise LiveHandError(
            f"frames with two hands must label each ('Left' or 'Right'), got none in frame {crowded[0]}; {EXAMPLE}"
        )
    hands: dict[Side, dict[int, Sighting]] = {side: {} for side in SIDES}
    dropped = 0
    for number, seen in frames.items():
        for hand in sorted(seen, key=lambda hand: -(hand.label.score if hand.label else 0)):
            if hand.label is None or number in hands[hand.label.side]:
                dropped += 1
            else:
                hands[hand.label.side][number] = hand
    notes = (f"{dropped} hands share a label with a surer one of their frame and are left out",) if dropped else ()
    return [hands[side] for side in SIDES], notes


def _of_single_hands(seen: dict[int, Sighting]) -> tuple[list[dict[int, Sighting]], tuple[str, ...]]:
    """Follow one hand whose label may flicker, or two that are never there together."""
    sides = {number: hand.label.side for number, hand in seen.items() if hand.label}
    counts = {side: sum(one == side for one in sides.values()) for side in SIDES}
    fewer: Side = "left" if counts["left"] <= counts["right"] else "right"
    if counts[fewer] <= _FLICKER * len(sides):
        notes = (f"{counts[fewer]} frames are labelled as the other hand: read as the same one",)
        return [seen], notes if counts[fewer] else ()
    return [{number: hand for number, hand in seen.items() if sides.get(number) == side} for side in SIDES], ()


def _track(frames: Mapping[int, Sighting], first: int) -> Track:
    numbers = sorted(frames)
    labels = [frames[number].label for number in numbers]
    known = [label for label in labels if label is not None]
    lefts = sum(label.side == "left" for label in known)
    side: Side = "left" if 2 * lefts > len(known) else "right"
    points = np.stack([frames[number].points for number in numbers])
    return Track(points, np.array(numbers) - first, side if known else None, all(label.is_own for label in known))
