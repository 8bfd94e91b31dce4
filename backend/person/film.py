"""A film of a hand as pictures of a person: the sharpest of its frames that differ most."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import atan, degrees, radians, tan
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..capture.masks.mask import load_opencv
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..motion.landmarks.take_file import FilmedTake
from ..motion.landmarks.take_fit import FilmedHand
from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.hand_picture import HandPicture, PicturedHand
from ..records.side import Side
from ..system.thread_limits import thread_limit
from ..tracking.resting_camera import MOST_CHANGE
from ..tracking.sighted_take import filmed_take, frames_of_film
from ..tracking.turning_hand.coverage import covered_share
from ..tracking.turning_hand.filmed_capture import hand_to_capture, looked_at
from ..tracking.turning_hand.frame_choice import chosen_frames, smear_of
from ..tracking.turning_hand.hand_frames import film_camera, frames_of, hand_frames
from ..tracking.turning_hand.take_shape import fit_with_shape
from ..tracking.turning_hand.window import Window, camera_of, image_of, window_around
from .clean_plate import clean_plate, small_enough
from .film_exposure import backdrop_gains, backdrop_sample
from .kept_steps import FILMED_TAKE, KeptSteps
from .other_hands import in_window, where_hands_may_be
from .skin_masks import labelled

if TYPE_CHECKING:
    from ..tracking.tracked_hand import TrackedHand
    from ..tracking.weights import TrackerNetworks

Progress = Callable[[str], None]
"""Is told, in words for people, what begins."""

LONGEST_PX = 900
"""The longer side of a hand in its picture."""
USUAL_FOV_DEG = 65.0
"""Along the longer side, where nothing tells it: of a phone's main camera, 24 to 26 mm in terms of a 35 mm film."""
HELD_OUT_EVERY = 6
LITTLE_SKIN = 0.6
"""Share of the skin below which people are told that the rest is a guess; a hand's one side is about 0.45."""
_MOST_FPS = 10.0  # that are tracked: of 30 s, 300 frames to choose from
_CROWD_SAMPLES, _MOST_HANDS = 5, 2
_COVERED_SHARE = 0.25  # of a picture's size, in which it is found what the hand covers


def pictures_of_film(
    path: Path,
    model: HandModel,
    progress: Progress,
    side: Side | None = None,
    most: int = 40,
    networks: TrackerNetworks | None = None,
    steps: KeptSteps | None = None,
    fov_deg: float | None = None,
) -> PicturedHand:
    """Track a film and choose pictures of one hand; the camera need not rest, its own axes are the scene's world.

    Args:
        path: the film.
        model: the built-in hand.
        progress: is told what begins.
        side: of the hand; None: the one that more frames show.
        most: number of pictures.
        networks: the tracker's; None: the user's own.
        steps: where the take is kept; None: nowhere.
        fov_deg: the camera's horizontal angle of view; None: a phone's (`usual_fov_deg`).

    Raises:
        LiveHandError: it is no film, or shows no hand, more than two hands, or nothing with the colour of skin.
    """
    from ..tracking.still import StillTracker
    from ..tracking.takes import track_frames
    from ..tracking.tracker import HandTracker
    from ..tracking.video import open_video
    from ..tracking.weights import load_networks

    load_opencv()
    networks = networks or load_networks()
    video, right = open_video(path), model.for_side("right")
    progress("tracking the film")
    play = partial(video.thinned, _MOST_FPS)

    def tracked() -> FilmedTake:
        found = track_frames(frames_of_film(video, _MOST_FPS), HandTracker(networks))
        return filmed_take(found, min(video.fps, _MOST_FPS), fov_deg or usual_fov_deg(found.size_px), path)

    take = (steps or KeptSteps()).kept("take", tracked, FILMED_TAKE)
    chosen_side = hand_to_capture(take, side)
    progress(f"fitting the {chosen_side} hand")
    with thread_limit(1):  # operations are small: threads would only wait for each other
        fit = fit_with_shape(take, chosen_side, model)
    seen = hand_frames(take, chosen_side, fit, right)
    progress("choosing pictures")
    camera = film_camera(take)
    blurs, change = looked_at(play, seen, camera.size_px)
    rests = change is not None and change <= MOST_CHANGE
    smears = smear_of(seen.px, seen.times_s)
    chosen = seen.of(chosen_frames(seen.motion, seen.fit_error, blurs, smears, least=1, most=most))
    poses = [chosen.motion.pose(index) for index in range(len(chosen.frames))]
    windows = [
        window_around(camera.project(posed_vertices(right, pose)[right.framed_vertices])[0], camera.size_px, LONGEST_PX)
        for pose in poses
    ]
    images: list[np.ndarray] = [np.empty(0)] * len(poses)
    backdrops: list[np.ndarray] = [np.empty(0)] * len(poses)
    behind: list[np.ndarray] = [np.empty(0)] * len(poses)
    crowd: list[Sequence[TrackedHand]] = []
    still = StillTracker(networks)
    step = max(1, len(poses) // _CROWD_SAMPLES)
    for index, picture in frames_of(play, chosen.frames):
        shown = picture[:, ::-1] if chosen_side == "left" else picture
        images[index] = np.ascontiguousarray(image_of(shown, windows[index]))
        backdrops[index] = backdrop_sample(shown, _box_px(windows[index]))
        behind[index] = small_enough(shown)
        crowd += [still.hands(picture)] if index % step == 0 else []
    check_one_person(path, crowd)
    cameras = [camera_of(camera, window) for window in windows]
    progress(f"masking {len(poses)} pictures")
    others_px = _others_px(take, chosen_side, chosen.frames, camera, cameras)
    plates = None
    if rests:
        plate = clean_plate(behind, _covered(take, chosen_side, chosen.frames), camera.size_px)
        plates = [plate.within(window) for window in windows]
    labels = labelled(images, poses, cameras, right, others_px, plates)
    gains = backdrop_gains(backdrops)
    log_gains = np.zeros((len(poses), 3)) if gains is None else gains
    pictures = tuple(
        HandPicture(
            f"{path.name}, {take.times[frame]:.2f} s",
            image,
            label,
            its_camera,
            pose,
            is_held_out=is_held_out(index, len(poses)),
            log_gain=tuple(log_gains[index].tolist()),
        )
        for index, (frame, image, label, its_camera, pose) in enumerate(
            zip(chosen.frames.tolist(), images, labels, cameras, poses, strict=True)
        )
    )
    notes = [note for note in (_moves(change), unseen_note(covered_share(poses, cameras, right))) if note]
    return PicturedHand(pictures, chosen_side, path.name, notes=tuple(notes))


def _covered(take: FilmedTake, side: Side, frames: np.ndarray) -> list[np.ndarray]:
    """Find where hands may be in each frame, in pictures of a quarter of its size; those of left hands are mirrored."""
    width, height = take.camera.size_px
    small_px = max(1, round(_COVERED_SHARE * width)), max(1, round(_COVERED_SHARE * height))
    turn, shift = (1, 0) if side == "right" else (-1, width)
    share = np.array(small_px) / (width, height)
    found = ([hand.px[at] for hand in take.hands.values() for at in _at(hand, frame)] for frame in frames)
    return [where_hands_may_be([(px * [turn, 1] + [shift, 0]) * share for px in hands], small_px) for hands in found]


def _others_px(
    take: FilmedTake, side: Side, frames: np.ndarray, camera: Camera, cameras: Sequence[Camera]
) -> list[list[np.ndarray]]:
    """Find the landmarks [21, 2] of the other hand in each frame's picture; pictures of left hands are mirrored."""
    turn, shift = (1, 0) if side == "right" else (-1, take.camera.size_px[0])
    others = [hand for its_side, hand in take.hands.items() if its_side != side]
    return [
        [in_window(hand.px[at] * [turn, 1] + [shift, 0], camera, part) for hand in others for at in _at(hand, frame)]
        for frame, part in zip(frames, cameras, strict=True)
    ]


def _at(hand: FilmedHand, frame: int) -> np.ndarray:
    return np.flatnonzero(hand.frames == frame)


def usual_fov_deg(size_px: tuple[int, int]) -> float:
    """Return the horizontal angle of view that a phone's film of this (width, height) usually has."""
    return degrees(2 * atan(size_px[0] / max(size_px) * tan(radians(USUAL_FOV_DEG) / 2)))


def is_held_out(index: int, count: int) -> bool:
    """Tell whether a picture is kept from the fits: every sixth, of enough of them."""
    return count >= HELD_OUT_EVERY and index % HELD_OUT_EVERY == HELD_OUT_EVERY // 2


def unseen_note(share: float) -> str | None:
    """Word that a part of the skin is a guess; None if most of it was seen."""
    if share >= LITTLE_SKIN:
        return None
    return f"the pictures show {share:.0%} of the hand's skin, the rest is a guess; turn the hand to show palm and back"


def check_one_person(path: Path, found: Sequence[Sequence[TrackedHand]]) -> None:
    """Raise LiveHandError if most pictures show more than two hands, and so more than one person."""
    counts = [len(hands) for hands in found]
    if 2 * sum(count > _MOST_HANDS for count in counts) > len(counts):
        raise LiveHandError(
            f"{path} must show one person, got {max(counts)} hands in one picture; film one person's hand alone"
        )


def _box_px(window: Window) -> np.ndarray:
    """Return a window's (left, top, right, bottom), px."""
    return np.array([window.x, window.y, window.x + window.size_px[0], window.y + window.size_px[1]])


def _moves(change: float | None) -> str | None:
    if change is None or change <= MOST_CHANGE:
        return None
    return "the camera, or its light, moves: the light is taken to move with the camera"
