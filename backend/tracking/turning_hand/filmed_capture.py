"""Writes the capture of one hand that turns before a resting camera.

The world is Blender's; the camera is its origin and looks along +Y. Light that rests while the hand turns depends on
the surface's direction in this world, and so an avatar with baked light learns it. A left hand's pictures are mirrored,
since captures are of right hands.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from ...capture.capture import Capture, CaptureView, save_capture_index
from ...capture.importers.staging import check_target
from ...capture.masks.mask import MaskConfig, load_opencv
from ...capture.masks.mask_capture import mask_capture
from ...capture.split import split_of
from ...geometry.tolerances import NEAR_M
from ...hand.lbs import posed_vertices
from ...hand.model import HandModel
from ...motion.landmarks.take_file import FilmedTake
from ...motion.landmarks.take_fit import TakeFit
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.side import Side
from ..resting_camera import MOST_CHANGE, ground_change
from .coverage import covered_share
from .frame_choice import blur_of, chosen_frames, held_out, smear_of
from .hand_frames import Frames, HandFrames, film_camera, frames_of, hand_frames
from .window import Window, camera_of, image_of, window_around, with_points

MASKS = MaskConfig(erode_mm=6.0, dilate_mm=16.0, ends_at_wrist=True)
"""The fit of a film is farther off than that of a rig, and knows no bend of the wrist."""
_SAMPLES, _SAMPLE_WIDTH_PX = 16, 320  # in which it is seen whether the camera rests
_COVERED = 0.5  # of the hand's size, around its landmarks, in which the arm may be too


@dataclass(frozen=True)
class FilmedCapture:
    """What was written.

    Attributes:
        capture: with its masks.
        overlap: mean intersection over union of the masks and the posed mesh.
        frames: [N] of the film, one an image.
        fit_error: [N] of the fit in them.
        covered: share of the hand's skin that they show.
    """

    capture: Capture
    overlap: float
    frames: np.ndarray
    fit_error: np.ndarray
    covered: float


def check_capture_can_be_made(folder: Path) -> None:
    """Raise LiveHandError, before minutes of tracking, if the folder is not empty or OpenCV is missing."""
    check_target(folder)
    load_opencv()


def hand_to_capture(take: FilmedTake, wanted: Side | None) -> Side:
    """Choose the side of the hand that becomes a capture: the wanted one, or the one that more frames show.

    Raises:
        LiveHandError: the wanted hand is not in the film.
    """
    if wanted is not None and wanted not in take.hands:
        raise LiveHandError(
            f"--side must name a hand of the film, got {wanted}; it shows the {' and '.join(take.hands)}"
        )
    return wanted or max(take.hands, key=lambda side: len(take.hands[side].frames))


def write_filmed_capture(
    play: Frames, take: FilmedTake, side: Side, fit: TakeFit, model: HandModel, folder: Path, source: str
) -> FilmedCapture:
    """Write a capture of a fitted hand, completely or not at all.

    Args:
        play: the film.
        take: what was tracked in it.
        side: of the hand.
        fit: of that hand.
        model: that it was fitted with.
        folder: new or empty.
        source: the film's name.

    Raises:
        LiveHandError: the folder is not empty, the camera moves, or the hand does not turn enough.
    """
    check_capture_can_be_made(folder)
    right = model.for_side("right")
    camera = film_camera(take)
    seen = hand_frames(take, side, fit, right)
    blurs, change = looked_at(play, seen, camera.size_px)
    if change is not None and change > MOST_CHANGE:
        raise LiveHandError(
            f"the camera must rest while the hand turns, got a ground that changes by {change:.0f} of 255 "
            f"(at most {MOST_CHANGE:.0f}); put the phone on a stand, lock its exposure, and film again"
        )
    chosen = _chosen(seen, blurs, right, camera)
    poses = tuple(chosen.motion.pose(index) for index in range(len(chosen.frames)))
    windows = [_window_of(posed_vertices(right, pose), right, camera) for pose in poses]
    views = _views([camera_of(camera, window) for window in windows])
    provenance = _provenance(source, take, side, chosen)
    with _whole_or_not_at_all(folder) as partial:
        (partial / "images").mkdir()
        for index, picture in frames_of(play, chosen.frames):
            shown = picture[:, ::-1] if side == "left" else picture
            Image.fromarray(image_of(shown, windows[index])).save(partial / views[index].file)
        capture = Capture(partial, right.sha256, provenance, poses, views)
        save_capture_index(capture)
        masked = mask_capture(partial, right, MASKS)
    views = tuple(each.view for each in masked)
    overlap = float(np.mean([each.overlap for each in masked]))
    covered = covered_share(poses, [camera] * len(poses), right)
    return FilmedCapture(
        replace(capture, folder=folder, views=views), overlap, chosen.frames, chosen.fit_error, covered
    )


def _chosen(seen: HandFrames, blurs: np.ndarray, right: HandModel, camera: Camera) -> HandFrames:
    """Choose the frames of the capture; where they are too few, the error says how much skin all of them show."""
    try:
        return seen.of(chosen_frames(seen.motion, seen.fit_error, blurs, smear_of(seen.px, seen.times_s)))
    except LiveHandError as error:
        some = range(0, len(seen.frames), max(1, len(seen.frames) // _SAMPLES))
        share = covered_share([seen.motion.pose(index) for index in some], [camera] * len(some), right)
        raise LiveHandError(f"{error}; the film shows {share:.0%} of the hand's skin") from error


def _window_of(vertices: np.ndarray, right: HandModel, camera: Camera) -> Window:
    """Return the window around a hand and the straight arm that its model has.

    Whether the film shows skin or a sleeve behind the wrist, and how it bends, is not known. The masks leave it out; so
    that an avatar learns to be transparent there on its whole length, the image shows the place of all of it.
    """
    px, depth_m = camera.project(vertices)
    return with_points(window_around(px[right.framed_vertices], camera.size_px), px[depth_m > NEAR_M])


def looked_at(play: Frames, seen: HandFrames, size_px: tuple[int, int]) -> tuple[np.ndarray, float | None]:
    """Measure how blurred each frame's hand is [N], and how much the ground changes."""
    blurs = np.ones(len(seen.frames))
    step = max(1, len(seen.frames) // _SAMPLES)
    pictures, covered = [], []
    for index, picture in frames_of(play, seen.frames):
        blurs[index] = blur_of(window_around(seen.px[index], size_px).of(picture))
        if index % step == 0:
            small, mask = _sample(picture, seen.px[index])
            pictures.append(small)
            covered.append(mask)
    return blurs, ground_change(pictures, covered)


def _sample(picture: np.ndarray, px: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sample a small picture, and where in it the hand or its arm may be."""
    step = max(1, picture.shape[1] // _SAMPLE_WIDTH_PX)
    small = picture[::step, ::step]
    low, high = px.min(0), px.max(0)
    margin = _COVERED * (high - low).max()
    rows, columns = (np.arange(count) * step for count in small.shape[:2])
    is_row = (rows >= low[1] - margin) & (rows <= high[1] + margin)
    is_column = (columns >= low[0] - margin) & (columns <= high[0] + margin)
    return small, is_row[:, None] & is_column


def _views(cameras: Sequence[Camera]) -> tuple[CaptureView, ...]:
    is_out = held_out(len(cameras))
    return tuple(
        CaptureView(f"images/{index:04d}.png", camera, 0, index, split_of(bool(is_out[index]), False))
        for index, camera in enumerate(cameras)
    )


def _provenance(source: str, take: FilmedTake, side: Side, chosen: HandFrames) -> dict[str, Any]:
    """Describe the capture, and so the header of an avatar trained on it, which gets its person's shape from it."""
    return {
        "made_by": "livehand track",
        "source": source,
        "side": side,
        "is_mirrored": side == "left",
        "focal_px": take.camera.focal_px,
        "plan": {"person": {"beta": chosen.motion.betas[0].tolist()}},
        "frames": chosen.frames.tolist(),
        "doubt": [round(float(value), 5) for value in chosen.fit_error],
    }


@contextmanager
def _whole_or_not_at_all(folder: Path) -> Iterator[Path]:
    """Yield a new folder that takes the place of the empty or missing one at the end, and is removed on failure."""
    partial = folder.with_name(f".{folder.name}.{secrets.token_hex(8)}.partial")
    try:
        partial.mkdir(parents=True)
        yield partial
        if folder.exists():
            folder.rmdir()  # empty
        partial.rename(folder)
    except OSError as error:
        raise LiveHandError(f"{folder} must be writable ({error}); make room, or choose another folder") from error
    finally:
        shutil.rmtree(partial, ignore_errors=True)
