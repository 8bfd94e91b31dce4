"""Measure poses of a film from one camera against two: `python -m livehand.tools.person.stereo_gate FOLDER`.

FOLDER holds two films of one hand at the same moments, `cam0_test.mp4` and `cam1_test.mp4`, and their calibrations,
`c0.dat` and `rot_trans_c0.dat` (gate 9). The truth is made of the same tracker's points in both films, with bones of
constant length, and smoothed, so that it shares the tracker's mistakes.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from math import degrees
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.motion.landmarks.lifting import mediapipe_lifting
from ...backend.motion.landmarks.skeleton import NODES_OF_LANDMARKS, HandSkeleton, landmarks_of
from ...backend.motion.landmarks.take_file import FilmedTake
from ...backend.motion.landmarks.take_fit import sighted
from ...backend.records.side import Side
from ...backend.tracking.sighted_take import filmed_take, frames_of_film
from ...backend.tracking.takes import track_frames
from ...backend.tracking.tracker import HandTracker
from ...backend.tracking.turning_hand.filmed_capture import hand_to_capture
from ...backend.tracking.turning_hand.take_shape import fit_with_shape
from ...backend.tracking.video import open_video
from ...backend.tracking.weights import load_networks
from .gates import Gate
from .stereo_truth import CHAINS, CalibratedLens, Path3D, StereoTruth, stereo_truth


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the gates of both cameras, and what tells how good the truth is."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="of films and calibrations")
    folder, hand = parser.parse_args(arguments).folder, load_default_hand()
    lenses = [read_lens(folder, index) for index in (0, 1)]
    takes = [_take(folder / f"cam{index}_test.mp4", lens) for index, lens in enumerate(lenses)]
    side = hand_to_capture(takes[0], None)
    fits = [_fitted(take, side, hand) for take in takes]
    truth = stereo_truth([_points_px(take, side, hand) for take in takes], lenses, fits[0])
    for index, fit in enumerate(fits):
        for gate in gates_of(fit, truth.constant):
            sys.stdout.write(f"camera {index}: {gate.line()}\n")
    for row in information_of(fits, truth):
        sys.stdout.write(f"{row.line().rstrip()}\n")


def read_lens(folder: Path, index: int) -> CalibratedLens:
    """Read a camera's two files: words name what follows."""
    inner = _numbers((folder / f"c{index}.dat").read_text(encoding="utf-8"))
    outer = _numbers((folder / f"rot_trans_c{index}.dat").read_text(encoding="utf-8").partition("#")[0])
    world2cam = np.concatenate([outer[:9].reshape(3, 3), outer[9:12, None]], 1)
    return CalibratedLens(inner[:9].reshape(3, 3), inner[9:14], world2cam)


def _numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split() if not word.endswith(":")])


def _take(film: Path, lens: CalibratedLens) -> FilmedTake:
    video = open_video(film)
    found = track_frames(frames_of_film(video, video.fps), HandTracker(load_networks()))
    fov_deg = degrees(2 * np.arctan(found.size_px[0] / 2 / lens.K[0, 0]))
    return filmed_take(found, video.fps, fov_deg, film)


def _fitted(take: FilmedTake, side: Side, hand: HandModel) -> Path3D:
    fit = fit_with_shape(take, side, hand)
    first = round(fit.start_s * take.fps)
    points = np.stack([landmarks_of(hand.for_side(side), fit.motion.pose(row)) for row in range(len(fit.motion))])
    kept = np.flatnonzero(fit.is_keyed)
    return Path3D(points[kept], first + kept)


def _points_px(take: FilmedTake, side: Side, hand: HandModel) -> tuple[np.ndarray, np.ndarray]:
    """Return the joints [T, 21, 2] px as the tracker's points tell them, in the frames [T] that show the hand."""
    skeleton, found = HandSkeleton.of(hand), take.hands[side]
    seen = sighted(found, take.times, take.camera, side, skeleton.offsets(np.zeros(10)), mediapipe_lifting)
    rows = np.flatnonzero(seen.is_seen)
    nodes = seen.lifted.picture_points[rows] * ([-1, 1] if side == "left" else [1, 1])
    px = nodes[:, list(NODES_OF_LANDMARKS)] * take.camera.focal_px + np.array(take.camera.size_px) / 2
    return px, rows + int(found.frames[0])


def gates_of(fit: Path3D, truth: Path3D) -> list[Gate]:
    """Measure a fit in the frames that the truth has, too."""
    bends_deg, joints_mm = off_by(fit, truth)
    return [
        Gate("9 bends off by, deg", bends_deg, most=7),
        Gate("9 joints off by after similarity (PA), mm", joints_mm, most=7),
        Gate("9 jitter, mm/frame^2", jitter_mm(fit), most=1),
    ]


def information_of(fits: Sequence[Path3D], truth: StereoTruth) -> list[Gate]:
    """Measure what tells how far to trust the gates, of two cameras' fits; nothing is asked of it."""
    rows = []
    for index, fit in enumerate(fits):
        bends_deg, joints_mm = off_by(fit, truth.plain)
        rows.append(Gate(f"camera {index}: bends off plain triangulation, deg", bends_deg))
        rows.append(Gate(f"camera {index}: PA off plain triangulation, mm", joints_mm))
    return [
        *rows,
        Gate("the two cameras' bends differ by, deg", off_by(*fits)[0]),
        Gate("plain triangulation's bones vary by, mm", bones_vary_mm(truth.plain)),
        Gate("the truth's bones vary by, mm", bones_vary_mm(truth.constant)),
        Gate("the truth's own jitter, mm/frame^2", jitter_mm(truth.constant)),
    ]


def off_by(path: Path3D, other: Path3D) -> tuple[float, float]:
    """Compare bends, deg, and joints after similarity, mm, in the frames that both have."""
    frames = np.intersect1d(path.frames, other.frames)
    ours, true = (each.points[np.isin(each.frames, frames)] for each in (path, other))
    off_deg = np.degrees(np.abs(bends_rad(ours) - bends_rad(true)))
    off_mm = [1000 * np.linalg.norm(aligned(a, b) - b, axis=-1).mean() for a, b in zip(ours, true, strict=True)]
    return float(off_deg.mean()), float(np.mean(off_mm))


def bends_rad(points: Float[np.ndarray, "T 21 3"]) -> Float[np.ndarray, "T 5 3"]:
    """Compute the angles between bones that follow one another."""
    bones = np.diff(points[:, CHAINS], axis=2)
    bones = bones / np.linalg.norm(bones, axis=-1, keepdims=True)
    return np.arccos((bones[:, :, 1:] * bones[:, :, :-1]).sum(-1).clip(-1, 1))


def aligned(points: Float[np.ndarray, "N 3"], to: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 3"]:
    """Move points by the similarity that brings them nearest (Procrustes)."""
    mean, mean_to = points.mean(0), to.mean(0)
    left, spread, right = np.linalg.svd((to - mean_to).T @ (points - mean))
    signs = np.array([1, 1, np.sign(np.linalg.det(left @ right))])
    scale = (spread * signs).sum() / ((points - mean) ** 2).sum()
    return scale * (points - mean) @ (left * signs @ right).T + mean_to


def jitter_mm(path: Path3D) -> float:
    """Compute the mean length of joints' second differences about the wrist, over frames that follow one another."""
    about = 1000 * (path.points - path.points[:, :1])
    second = about[2:] - 2 * about[1:-1] + about[:-2]
    follow: Bool[np.ndarray, " T"] = (path.frames[2:] - path.frames[:-2]) == 2
    return float(np.linalg.norm(second[follow], axis=-1).mean())


def bones_vary_mm(path: Path3D) -> float:
    """Compute the standard deviation over time of a bone's length, as a mean over the bones."""
    bones = np.diff(path.points[:, CHAINS], axis=2)
    return float(1000 * np.linalg.norm(bones, axis=-1).std(0).mean())


if __name__ == "__main__":
    main()
