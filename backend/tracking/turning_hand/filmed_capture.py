"""Writes the capture of one hand that turns before a resting camera.

The world is Blender's; the camera is its origin and looks along +Y. Light that rests while the hand turns depends on
the surface's direction in this world, and so an avatar with baked light learns it. A left hand's pictures are mirrored,
since captures are of right hands.
"""

from __future__ import annotations

import secrets
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

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
from ...motion.landmarks.take_fit import MOST_FIT_ERROR, TakeFit
from ...motion.motion import HandMotion, mirrored
from ...motion.resampling import sampled_at
from ...motion.spaces import rest_wrists, to_blender, transformed
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.side import Side
from ..resting_camera import MOST_CHANGE, ground_change
from ..video import VideoFrame
from .frame_choice import blur_of, chosen_frames, held_out

LONGEST_PX = 512
"""The longer side of a hand in its image; larger ones are made smaller."""
_MARGIN = 0.12  # of the hand's longer side, on each side
_LEAST_PX = 8
_FARTHEST = 1.0  # of the window's longer side, beyond it: an arm is as long as a hand


class Window(NamedTuple):
    """A rectangle of whole pixels, of which a part may lie beyond the picture.

    Attributes:
        x: of the upper left pixel.
        y: of that pixel.
        size_px: (width, height).
        share: size of its image against its own, at most 1.
    """

    x: int
    y: int
    size_px: tuple[int, int]
    share: float = 1.0

    def of(self, picture: np.ndarray) -> np.ndarray:
        """Cut it out of a picture [H, W, ...]; beyond the picture, the picture's edge goes on."""
        width, height = self.size_px
        rows = (self.y + np.arange(height)).clip(0, picture.shape[0] - 1)
        columns = (self.x + np.arange(width)).clip(0, picture.shape[1] - 1)
        return picture[rows[:, None], columns]

    def image_size_px(self) -> tuple[int, int]:
        """Return the size of its image (width, height)."""
        width, height = (max(1, round(side * self.share)) for side in self.size_px)
        return width, height


def window_around(points_px: np.ndarray, size_px: tuple[int, int]) -> Window:
    """Return the window around a hand's points [N, 2], with a margin, inside a picture of a size (width, height)."""
    low, high = points_px.min(0), points_px.max(0)
    margin = _MARGIN * (high - low).max()
    limit = np.array(size_px)
    first = np.clip(np.floor(low - margin), 0, limit - _LEAST_PX).astype(int)
    last = np.clip(np.ceil(high + margin), first + _LEAST_PX, limit).astype(int)
    return _window(first, last, min(1.0, LONGEST_PX / (last - first).max()))


def with_points(window: Window, points_px: np.ndarray) -> Window:
    """Enlarge a window until it holds points [N, 2] as well, also beyond the picture; its image keeps its scale."""
    first, size = np.array([window.x, window.y]), np.array(window.size_px)
    farthest = np.ceil(_FARTHEST * size.max())
    low, high = np.floor(points_px.min(0)), np.ceil(points_px.max(0))
    first, last = (
        np.clip(low, first - farthest, first).astype(int),
        np.clip(high, first + size, first + size + farthest).astype(int),
    )
    return _window(first, last, window.share)


def _window(first: np.ndarray, last: np.ndarray, share: float) -> Window:
    (x, y), (width, height) = first.tolist(), (last - first).tolist()
    return Window(x, y, (width, height), share)


def camera_of(camera: Camera, window: Window) -> Camera:
    """Return the camera of a window's image."""
    cropped, size_px = camera.cropped(window.x, window.y, window.size_px), window.image_size_px()
    shares = [after / before for after, before in zip(size_px, window.size_px, strict=True)]
    return replace(cropped, K=np.diag([*shares, 1.0]) @ cropped.K, size_px=size_px)


def image_of(picture: np.ndarray, window: Window) -> np.ndarray:
    """Return a window's image, uint8 [h, w, 3]."""
    part, size_px = window.of(picture), window.image_size_px()
    if size_px == window.size_px:
        return part
    return np.asarray(Image.fromarray(part).resize(size_px, Image.Resampling.BOX))


Frames = Callable[[], Iterable[VideoFrame]]
"""Plays the film from its start."""
MASKS = MaskConfig(erode_mm=6.0, dilate_mm=16.0, ends_at_wrist=True)
"""The fit of a film is farther off than that of a rig, and knows no bend of the wrist."""
_SAMPLES, _SAMPLE_WIDTH_PX = 16, 320  # in which it is seen whether the camera rests
_COVERED = 0.5  # of the hand's size, around its landmarks, in which the arm may be too
_LEAST_INSIDE = 0.95  # of the landmarks, in the picture


@dataclass(frozen=True)
class FilmedCapture:
    """What was written.

    Attributes:
        capture: with its masks.
        overlap: mean intersection over union of the masks and the posed mesh.
        frames: [N] of the film, one an image.
        fit_error: [N] of the fit in them.
    """

    capture: Capture
    overlap: float
    frames: np.ndarray
    fit_error: np.ndarray


@dataclass(frozen=True)
class _Candidates:
    """Frames of the film in which the hand is seen whole, without a large fit error, as a right hand's.

    Attributes:
        frames: [N] increasing indices.
        motion: of N poses, in the capture's world.
        fit_error: [N].
        px: [N, 21, 2] landmarks in the picture.
    """

    frames: np.ndarray
    motion: HandMotion
    fit_error: np.ndarray
    px: np.ndarray

    def of(self, indices: np.ndarray) -> _Candidates:
        motion = replace(self.motion, theta=self.motion.theta[indices], transl=self.motion.transl[indices])
        return _Candidates(self.frames[indices], motion, self.fit_error[indices], self.px[indices])


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
    camera = _camera(take)
    seen = _candidates(take, side, fit, right)
    blurs, change = _looked_at(play, seen, camera.size_px)
    if change is not None and change > MOST_CHANGE:
        raise LiveHandError(
            f"the camera must rest while the hand turns, got a ground that changes by {change:.0f} of 255 "
            f"(at most {MOST_CHANGE:.0f}); put the phone on a stand, lock its exposure, and film again"
        )
    chosen = seen.of(chosen_frames(seen.motion, seen.fit_error, blurs))
    poses = tuple(chosen.motion.pose(index) for index in range(len(chosen.frames)))
    windows = [_window_of(posed_vertices(right, pose), right, camera) for pose in poses]
    views = _views([camera_of(camera, window) for window in windows])
    provenance = _provenance(source, take, side, chosen)
    with _whole_or_not_at_all(folder) as partial:
        (partial / "images").mkdir()
        for index, picture in _shown(play, chosen.frames):
            shown = picture[:, ::-1] if side == "left" else picture
            Image.fromarray(image_of(shown, windows[index])).save(partial / views[index].file)
        capture = Capture(partial, right.sha256, provenance, poses, views)
        save_capture_index(capture)
        masked = mask_capture(partial, right, MASKS)
    views = tuple(each.view for each in masked)
    overlap = float(np.mean([each.overlap for each in masked]))
    return FilmedCapture(replace(capture, folder=folder, views=views), overlap, chosen.frames, chosen.fit_error)


def _camera(take: FilmedTake) -> Camera:
    """Return the film's camera, in the world that `_candidates` brings the hand to."""
    width, height = take.camera.size_px
    K = np.array([[take.camera.focal_px, 0, width / 2], [0, take.camera.focal_px, height / 2], [0, 0, 1.0]])
    return Camera(K, to_blender("opencv"), take.camera.size_px)


def _window_of(vertices: np.ndarray, right: HandModel, camera: Camera) -> Window:
    """Return the window around a hand and the straight arm that its model has.

    Whether the film shows skin or a sleeve behind the wrist, and how it bends, is not known. The masks leave it out; so
    that an avatar learns to be transparent there on its whole length, the image shows the place of all of it.
    """
    px, depth_m = camera.project(vertices)
    return with_points(window_around(px[right.framed_vertices], camera.size_px), px[depth_m > NEAR_M])


def _candidates(take: FilmedTake, side: Side, fit: TakeFit, right: HandModel) -> _Candidates:
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
    return _Candidates(hand.frames[is_sure], motion, fit_error[is_sure], hand.px[is_sure])


def _looked_at(play: Frames, seen: _Candidates, size_px: tuple[int, int]) -> tuple[np.ndarray, float | None]:
    """Measure how blurred each frame's hand is [N], and how much the ground changes."""
    blurs = np.ones(len(seen.frames))
    step = max(1, len(seen.frames) // _SAMPLES)
    pictures, covered = [], []
    for index, picture in _shown(play, seen.frames):
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


def _shown(play: Frames, frames: np.ndarray) -> Iterator[tuple[int, np.ndarray]]:
    """Yield the index among the frames, and the picture, of each of them."""
    index_of = {int(frame): index for index, frame in enumerate(frames)}
    for frame, (_, picture) in enumerate(play()):
        if frame in index_of:
            yield index_of[frame], picture


def _views(cameras: Sequence[Camera]) -> tuple[CaptureView, ...]:
    is_out = held_out(len(cameras))
    return tuple(
        CaptureView(f"images/{index:04d}.png", camera, 0, index, split_of(bool(is_out[index]), False))
        for index, camera in enumerate(cameras)
    )


def _provenance(source: str, take: FilmedTake, side: Side, chosen: _Candidates) -> dict[str, Any]:
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
