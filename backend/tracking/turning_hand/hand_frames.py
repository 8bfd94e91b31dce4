"""Frames of a film that show a hand whole and sure: what captures and persons are made of.

The world is Blender's; the camera is its origin and looks along +Y.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...hand.model import HandModel
from ...motion.landmarks.take_file import FilmedTake
from ...motion.landmarks.take_fit import MOST_FIT_ERROR, TakeFit
from ...motion.motion import HandMotion, mirrored
from ...motion.resampling import sampled_at
from ...motion.spaces import rest_wrists, to_blender, transformed
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.side import Side
from ..video import VideoFrame

Frames = Callable[[], Iterable[VideoFrame]]
"""Plays the film from its start."""
_LEAST_INSIDE = 0.95  # of the landmarks, in the picture


@dataclass(frozen=True)
class HandFrames:
    """Frames of the film in which the hand is seen whole, with a small fit error, as a right hand's.

    Attributes:
        frames: [N] increasing indices.
        times_s: [N] of the film.
        motion: of N poses, in the capture's world.
        fit_error: [N].
        px: [N, 21, 2] landmarks in the picture.
    """

    frames: np.ndarray
    times_s: np.ndarray
    motion: HandMotion
    fit_error: np.ndarray
    px: np.ndarray

    def of(self, indices: np.ndarray) -> HandFrames:
        """Select some of the frames."""
        motion = replace(self.motion, theta=self.motion.theta[indices], transl=self.motion.transl[indices])
        return HandFrames(
            self.frames[indices], self.times_s[indices], motion, self.fit_error[indices], self.px[indices]
        )


def film_camera(take: FilmedTake) -> Camera:
    """Return the film's camera, in the world that `hand_frames` brings the hand to."""
    width, height = take.camera.size_px
    K = np.array([[take.camera.focal_px, 0, width / 2], [0, take.camera.focal_px, height / 2], [0, 0, 1.0]])
    return Camera(K, to_blender("opencv"), take.camera.size_px)


def hand_frames(take: FilmedTake, side: Side, fit: TakeFit, right: HandModel) -> HandFrames:
    """Select the frames that show a fitted hand whole, in the world of `film_camera`.

    Raises:
        LiveHandError: there are none.
    """
    hand = take.hands[side]
    times = take.times[hand.frames]
    at = (times - fit.start_s) * (fit.motion.fps or take.fps)
    nearest = np.clip(np.round(at).astype(int), 0, len(fit.motion) - 1)
    inside = ((hand.px >= 0) & (hand.px < take.camera.size_px)).all(-1).mean(1)
    fit_error = fit.fit_error[nearest]
    is_sure = fit.is_keyed[nearest] & (fit_error < MOST_FIT_ERROR) & (inside >= _LEAST_INSIDE)
    if not is_sure.any():
        raise LiveHandError(
            f"a capture needs a hand that is seen whole, got none of {len(times)} frames with a small fit error; "
            "film the whole hand, larger and in light"
        )
    motion = sampled_at(fit.motion, at[is_sure])
    motion = motion if side == "right" else mirrored(motion)
    motion = transformed(motion, to_blender("opencv"), rest_wrists(right, motion.beta))
    return HandFrames(hand.frames[is_sure], times[is_sure], motion, fit_error[is_sure], hand.px[is_sure])


def frames_of(play: Frames, frames: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index among the frames, and the picture, of each of them."""
    index_of = {int(frame): index for index, frame in enumerate(frames)}
    for frame, (_, picture) in enumerate(play()):
        if frame in index_of:
            yield index_of[frame], picture
