"""The hands of a whole video: what was tracked frame by frame, put together by side."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..records.side import SIDES, Side
from .tracked_hand import TrackedHand, is_same_hand
from .video import VideoFrame

if TYPE_CHECKING:
    from .tracker import HandTracker

_LEAST_FRAMES = 5  # of a hand; shorter finds are mistakes
_MOST_SHARED = 0.2  # of a track's frames in which its side may be another's


@dataclass(frozen=True)
class HandSightings:
    """A hand in the N frames that show it.

    Attributes:
        frames: [N] increasing indices.
        px: [N, 21, 2] landmarks in the picture.
        world: [N, 21, 3] m about the hand's centre, in the camera's axes.
        presence: [N] 0..1.
    """

    frames: np.ndarray
    px: np.ndarray
    world: np.ndarray
    presence: np.ndarray


@dataclass(frozen=True)
class VideoSightings:
    """All hands of a video.

    Attributes:
        times: [T] s of all frames, increasing from 0.
        size_px: (width, height) of the pictures.
        hands: by side; a mirrored picture's are the other side's.
    """

    times: np.ndarray
    size_px: tuple[int, int]
    hands: Mapping[Side, HandSightings]


class FrameHands(NamedTuple):
    """One frame: its time, s, its size (width, height), and the hands in it."""

    time_s: float
    size_px: tuple[int, int]
    hands: Sequence[TrackedHand]


def track_frames(frames: Iterable[VideoFrame], tracker: HandTracker) -> VideoSightings:
    """Track the hands through frames, of which only one is kept at a time."""
    return put_together(
        FrameHands(time_s, (picture.shape[1], picture.shape[0]), tracker.track(picture)) for time_s, picture in frames
    )


def put_together(frames: Iterable[FrameHands]) -> VideoSightings:
    """Put together what was tracked, hand by hand; hands seen in a few frames only are left out."""
    times: list[float] = []
    seen: dict[int, list[tuple[int, TrackedHand]]] = {}
    size_px = (0, 0)
    for index, frame in enumerate(frames):
        times.append(frame.time_s)
        size_px = frame.size_px
        for hand in frame.hands:
            seen.setdefault(hand.track, []).append((index, hand))
    least = min(_LEAST_FRAMES, len(times))
    tracks = [track for track in seen.values() if len(track) >= least]
    return VideoSightings(np.array(times), size_px, by_side(tracks))


def by_side(tracks: Sequence[Sequence[tuple[int, TrackedHand]]]) -> dict[Side, HandSightings]:
    """Join tracks of (frame, hand) to one hand a side: a track has the side of its mean label.

    Of two hands seen together, the less surely labelled one has the other side; a third is left out. So is a track that
    lies on another's hand in the frames that show both, whatever its label.
    """
    tracks = _of_different_hands(tracks)
    slots: dict[Side, dict[int, TrackedHand]] = {side: {} for side in SIDES}
    for track in sorted(tracks, key=_sureness, reverse=True):
        right = np.mean([hand.right for _, hand in track])
        sides: tuple[Side, Side] = ("right", "left") if right > 0.5 else ("left", "right")
        for side in sides:
            shared = sum(index in slots[side] for index, _ in track)
            if shared <= _MOST_SHARED * len(track):
                slots[side] = dict(track) | slots[side]
                break
    return {side: _joined(slot) for side, slot in slots.items() if slot}


def _of_different_hands(
    tracks: Sequence[Sequence[tuple[int, TrackedHand]]],
) -> list[Sequence[tuple[int, TrackedHand]]]:
    kept: list[Sequence[tuple[int, TrackedHand]]] = []
    for track in sorted(tracks, key=len, reverse=True):
        if not any(_is_of_same_hand(track, dict(other)) for other in kept):
            kept.append(track)
    return kept


def _is_of_same_hand(track: Sequence[tuple[int, TrackedHand]], other: Mapping[int, TrackedHand]) -> bool:
    shared = [(hand, other[index]) for index, hand in track if index in other]
    return 2 * sum(is_same_hand(hand.px, its.px) for hand, its in shared) > len(shared)


def _sureness(track: Sequence[tuple[int, TrackedHand]]) -> float:
    """Measure how much a track's label says: its distance from none, over all frames."""
    return abs(sum(hand.right - 0.5 for _, hand in track))


def _joined(slot: Mapping[int, TrackedHand]) -> HandSightings:
    frames = sorted(slot)
    hands = [slot[frame] for frame in frames]
    return HandSightings(
        np.array(frames),
        np.stack([hand.px for hand in hands]),
        np.stack([hand.world for hand in hands]),
        np.array([hand.presence for hand in hands]),
    )
