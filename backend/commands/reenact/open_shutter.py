"""A re-enacted hand while the shutter is open: what moves is the mean of several renders."""

from __future__ import annotations

from collections.abc import Callable
from math import ceil

import numpy as np

from ...hand.lbs import posed_vertices
from ...image.exposure import Shutter, exposure_samples
from ...records.frame import Frame
from ...records.shot import Shot
from ...render.composition import mean_frame
from .filmed_shots import FilmedShots
from .overlay import faded, wrist_fade

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
