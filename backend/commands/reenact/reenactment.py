"""Re-enacts a tracked video: plate, gains, then frame after frame the avatars over the footage."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil

import numpy as np
from PIL import Image, ImageFilter

from ...hand.lbs import posed_vertices
from ...image.exposure import Shutter, exposure_samples
from ...records.frame import Frame
from ...records.shot import Shot
from ...render.composition import mean_frame
from ...render.renderer import Renderer
from ...tracking.video import VideoFrame
from .filmed_shots import FilmedShots
from .overlay import colour_gain, faded, over, smooth_gains, wrist_fade
from .plate import clean_plate

_SHARP_PX = 1.5  # path during the exposure, below which a frame is sharp
_STEP_PX = 3.0  # between two renders
_MOST_SAMPLES = 8
_FASTEST_SHARE = 95  # percentile of the vertices' paths: a fingertip may be all that moves


def exposed(
    shots: FilmedShots, index: int, render: Callable[[Shot], Frame], shutter_frames: float
) -> tuple[Frame, np.ndarray]:
    """Render a frame that fades at the wrist's cut, and its alpha [H, W] before that.

    Args:
        shots: the motion and its camera.
        index: of the motion's frame, in the middle of the exposure.
        render: the avatar's renderer.
        shutter_frames: how long the shutter is open; 0: a sharp frame.
    """
    count = sample_count(path_px(shots, index, shutter_frames)) if shutter_frames > 0 else 1
    shutter = Shutter(-shutter_frames / 2, shutter_frames)
    samples = exposure_samples(count, shutter, None) if count > 1 else exposure_samples(1, None, None)
    frames, sharp = [], []
    for sample in samples:
        shot = shots.shot(index + sample.offset_frames)
        sharp.append(render(shot))
        frames.append(hand_alone(sharp[-1], shot, shots))
    return mean_frame(frames), np.mean([frame.alpha for frame in sharp], 0)


def hand_alone(frame: Frame, shot: Shot, shots: FilmedShots) -> Frame:
    """Fade a frame out behind the wrist: nobody tracks the filmed arm, and a straight one would lie beside it."""
    return faded(frame, wrist_fade(frame, shot.camera, *shots.arm_reach(shot)))


def path_px(shots: FilmedShots, index: int, shutter_frames: float) -> float:
    """Measure how far the faster vertices move in the picture while the shutter is open."""
    points = []
    for offset in (-shutter_frames / 2, shutter_frames / 2):
        pose = shots.pose(index + offset)
        points.append(shots.camera.project(posed_vertices(shots.model, pose))[0])
    return float(np.percentile(np.linalg.norm(points[1] - points[0], axis=-1), _FASTEST_SHARE))


def sample_count(moved_px: float) -> int:
    """Count the renders for a path; one if it is short."""
    return 1 if moved_px < _SHARP_PX else min(max(2, ceil(moved_px / _STEP_PX) + 1), _MOST_SAMPLES)


_SAMPLES = 24  # frames that plate and gains are measured in
_SAMPLE_WIDTH_PX = 320
_MARGIN = 0.06  # of a sample's width, by which the real hand may stand out


@dataclass(frozen=True)
class Look:
    """What was measured of the footage.

    Attributes:
        plate: uint8 [H, W, 3] without the hand; None if the camera moves.
        times: [N] s of the samples with a hand.
        gains: for each avatar [N, 3], of its light.
    """

    plate: np.ndarray | None
    times: np.ndarray
    gains: tuple[np.ndarray, ...]


def measured_look(
    frames: Iterable[VideoFrame], count: int, hands: Sequence[FilmedShots], renderers: Sequence[Renderer]
) -> Look:
    """Measure plate and gains in some frames of the footage, evenly spread."""
    step = max(1, count // _SAMPLES)
    pictures, covered = [], []
    times: list[float] = []
    gains: list[list[np.ndarray]] = []
    for index, (time_s, picture) in enumerate(frames):
        if index % step:
            continue
        scale = min(1.0, _SAMPLE_WIDTH_PX / picture.shape[1])
        mask = np.zeros(picture.shape[:2], bool)
        for shots in hands:
            at = shots.index_at(time_s)
            if at is None:
                continue
            shot = shots.shot(at, scale)
            rendered = [hand_alone(renderer.render(shot), shot, shots) for renderer in renderers]
            height, width = rendered[0].alpha.shape
            small = np.asarray(Image.fromarray(picture).resize((width, height), Image.Resampling.BOX))
            found = [colour_gain(frame, small) for frame in rendered]
            if all(gain is not None for gain in found):
                times.append(time_s)
                gains.append([gain for gain in found if gain is not None])
            mask |= _grown(rendered[0].alpha > 0, (picture.shape[1], picture.shape[0]))
        pictures.append(picture)
        covered.append(mask)
    table = np.array(gains).reshape(-1, len(renderers), 3) if gains else np.ones((1, len(renderers), 3))
    plate = clean_plate(pictures, covered)
    return Look(plate, np.array(times or [0.0]), tuple(table[:, k] for k in range(len(renderers))))


def reenacted(
    frames: Iterable[VideoFrame],
    hands: Sequence[FilmedShots],
    renderers: Sequence[Renderer],
    look: Look,
    is_side_by_side: bool,
    shutter_frames: float,
) -> Iterator[np.ndarray]:
    """Put each avatar over the footage, side by side, uint8 [H, W * n, 3]; the original first where it is wanted.

    The shutter is open for so many frames around each; what moves meanwhile is blurred.
    """
    for time_s, picture in frames:
        shown = [picture] if is_side_by_side else []
        present = [(shots, at) for shots in hands if (at := shots.index_at(time_s)) is not None]
        for renderer, gains in zip(renderers, look.gains, strict=True):
            gain = smooth_gains(look.times, gains, np.array([time_s]))[0]
            shown.append(_composed(picture, present, renderer, gain, look.plate, shutter_frames))
        yield np.concatenate(shown, 1)


def _composed(
    picture: np.ndarray,
    present: Sequence[tuple[FilmedShots, int]],
    renderer: Renderer,
    gain: np.ndarray,
    plate: np.ndarray | None,
    shutter_frames: float,
) -> np.ndarray:
    if not present:
        return picture
    shots = [(one, at, one.shot(at)) for one, at in present]
    composed = picture
    for one, at, shot in sorted(shots, key=lambda each: -_depth(each[2])):  # the farther hand first
        frame, alpha = exposed(one, at, renderer.render, shutter_frames)
        ground = composed if plate is None else _over_plate(composed, plate, alpha, one.before_the_cut(shot))
        composed = over(frame, ground, gain)
    return composed


def _depth(shot: Shot) -> float:
    return float(np.median(shot.vertices @ shot.camera.cam2world[:3, 2]))


def _over_plate(picture: np.ndarray, plate: np.ndarray, alpha: np.ndarray, front: np.ndarray) -> np.ndarray:
    """Lay the plate around the avatar, where the real hand stands out, softly; the arm stays."""
    height, width = alpha.shape
    radius = max(1, round(_MARGIN * width * _SAMPLE_WIDTH_PX / (4 * max(width, _SAMPLE_WIDTH_PX))))
    small = Image.fromarray((alpha > 0.5).astype(np.uint8) * 255).resize((max(1, width // 4), max(1, height // 4)))
    soft = small.filter(ImageFilter.MaxFilter(2 * radius + 1)).filter(ImageFilter.GaussianBlur(radius / 2))
    share = (np.asarray(soft.resize((width, height)), np.float32) / 255 * front)[..., None]
    return (plate * share + picture * (1 - share)).round().astype(np.uint8)


def _grown(mask: np.ndarray, size_px: tuple[int, int]) -> np.ndarray:
    """Grow the mask by the margin: [H, W] bool, at the picture's size."""
    radius = max(1, round(_MARGIN * mask.shape[1]))
    grown = Image.fromarray(mask.astype(np.uint8) * 255).filter(ImageFilter.MaxFilter(2 * radius + 1))
    return np.asarray(grown.resize(size_px, Image.Resampling.NEAREST)) > 0
