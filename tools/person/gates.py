"""Measure a person that was made of a stranger's film: `python -m livehand.tools.person.gates AVATAR TRUTH`.

TRUTH is the folder that `film.py` filled. Gates 1 to 3: new poses, views and lights, with the true shape and with the
person's own; 5: melanin; 6: contrast of seen and unseen skin; 7: the tattoo; 10: time. `film_table` makes the people,
too, and measures their poses (4). Gains are not fitted: an albedo that is too bright is an error.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ...backend.avatars.avatar import Avatar
from ...backend.avatars.file import load_avatar
from ...backend.avatars.library import avatar_path
from ...backend.evaluation.exposure import exposed, exposure_gain
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.motion.motion import HandMotion
from ...backend.motion.spaces import rest_wrists, transformed
from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import HandPose, Shot
from ...backend.render.renderer import Renderer
from ...backend.render.surface_maps import surface_maps, vertex_map
from ...backend.research.pose_errors import pose_errors
from ...backend.surface.albedo_ratio import RATIO_ARRAY, RATIO_STEP
from ...backend.surface.detail_maps_file import ATLAS_MM
from .measures import PictureFigures, contrast_ratios, likeness, mean_figures, picture_figures
from .truth import Truth, read_truth

_ARM = 0.5  # of a vertex's weights of the wrist: what belongs to the arm is not measured
_SEEN = 64  # of the 255 of an avatar's confidence


class Gate(NamedTuple):
    """A figure and what it must be.

    Attributes:
        name: of the gate, with its number.
        value: that was measured.
        least, most: that pass; None: any.
    """

    name: str
    value: float
    least: float | None = None
    most: float | None = None

    @property
    def passes(self) -> bool | None:
        """Whether the value is within; None: nothing is asked of it."""
        if self.least is None and self.most is None:
            return None
        above = self.least is None or self.value >= self.least
        return bool(above and (self.most is None or self.value <= self.most))

    def line(self) -> str:
        """Word it for people."""
        asked = " ".join(
            f"{sign} {limit:g}" for sign, limit in ((">=", self.least), ("<=", self.most)) if limit is not None
        )
        verdict = {None: "", True: "passes", False: "FAILS"}[self.passes]
        return f"{self.name:46s} {self.value:9.3f}  {asked:18s} {verdict}"


class SceneFigures(NamedTuple):
    """One kept scene, truly and as an avatar shows it.

    Attributes:
        figures: of the hand's pixels.
        contrast: by side of the hand (seen, unseen) and band, over the true one.
        pixels: of each side.
    """

    figures: PictureFigures
    contrast: Mapping[str, Mapping[str, float]]
    pixels: Mapping[str, int]


def main(arguments: list[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("avatar", type=avatar_path, help="a file, or the name of one that ships")
    parser.add_argument("truth", type=Path, help="a folder of film.py")
    parser.add_argument("--numbers", type=Path, help="an avatar of the person's numbers alone")
    parser.add_argument("--seconds", type=float, help="that making the person took")
    args = parser.parse_args(arguments)
    load_before = os.getloadavg()[0]
    hand, truth, avatar = load_default_hand(), read_truth(args.truth), load_avatar(args.avatar)
    rows = picture_gates(avatar, truth, hand, load_avatar(args.numbers) if args.numbers else None)
    rows += number_gates(avatar, truth)
    if args.seconds is not None:
        rows.append(Gate("10 seconds", args.seconds, most=180))
    for row in rows:
        _say(row.line())
    _say(f"load of {os.cpu_count()} cores: {load_before:.1f} before, {os.getloadavg()[0]:.1f} after")


def picture_gates(avatar: Avatar, truth: Truth, hand: HandModel, numbers: Avatar | None = None) -> list[Gate]:
    """Measure gates 1, 2, 3 and 6."""
    true_shape = compared(avatar, truth, hand, truth.beta)
    own_shape = compared(avatar, truth, hand, own_beta(avatar))
    shown, own = (mean_figures([one.figures for one in some]) for some in (true_shape, own_shape))
    rows = [
        Gate("1 true shape, PSNR dB (3: inside the family 31)", shown.psnr_db, least=29),
        Gate("1 true shape, FLIP", shown.flip, most=0.15),
        Gate("2 own shape, PSNR dB", own.psnr_db, least=27.5),
        Gate("2 own shape, FLIP", own.flip),
        Gate("2 own shape, IoU", own.iou, least=0.96),
        *(Gate(f"  scene {index}, PSNR dB", one.figures.psnr_db) for index, one in enumerate(true_shape)),
    ]
    if numbers is not None:
        plain = compared(numbers, truth, hand, truth.beta)
        rows.append(Gate("1 numbers alone, PSNR dB", mean_figures([one.figures for one in plain]).psnr_db))
        over = [a.figures.psnr_db - b.figures.psnr_db for a, b in zip(true_shape, plain, strict=True)]
        rows.append(Gate("1 over numbers alone in the worst scene, dB", min(over), least=0))
    return rows + contrast_gates(true_shape)


def contrast_gates(scenes: Sequence[SceneFigures]) -> list[Gate]:
    """Measure gate 6: means over the pixels of all scenes of our contrast by the true one, by side and band."""
    rows = []
    for side, allowed in (("seen", 0.10), ("unseen", 0.25)):
        of_side = [one for one in scenes if one.contrast[side]]
        for key in of_side[0].contrast[side] if of_side else ():
            found = [(one.contrast[side][key], one.pixels[side]) for one in of_side if key in one.contrast[side]]
            ratios, pixels = np.transpose(found)
            value = float(np.average(ratios, weights=pixels))
            rows.append(Gate(f"6 contrast, {side} side, {key}", value, 1 - allowed, 1 + allowed))
    return rows


def number_gates(avatar: Avatar, truth: Truth) -> list[Gate]:
    """Measure gates 5 and 7."""
    surface = avatar.surface
    if surface is None:
        raise LiveHandError(f"the avatar must have a surface to be measured, got none in '{avatar.name}'")
    rows = [Gate("5 melanin, off by", abs(surface.person.melanin - truth.melanin), most=0.08)]
    if RATIO_ARRAY in surface.arrays and truth.drawn.any():
        log_ratio = RATIO_STEP * surface.arrays[RATIO_ARRAY].astype(np.float32)
        region = resized(truth.drawn.astype(np.float32), len(log_ratio)) > 0.5
        wanted = resized(truth.log_factor, len(log_ratio))
        rows.append(Gate("7 tattoo, correlation", likeness(log_ratio, wanted, region, ATLAS_MM / len(log_ratio)), 0.8))
    return rows


def pose_gates(fitted: Sequence[HandPose], frames: Sequence[int], truth: Truth, hand: HandModel) -> list[Gate]:
    """Measure gate 4 of poses in their cameras' axes, of these frames of the film."""
    errors = pose_errors(hand, fitted, poses_in_cameras(truth, frames, hand))
    return [
        Gate("4 tips, mm", errors.tips_mm, most=6),
        Gate("4 wrist, deg", errors.wrist_deg, most=2.5),
        Gate("4 fingers, deg", errors.fingers_deg, most=2.5),
    ]


def poses_in_cameras(truth: Truth, frames: Sequence[int], hand: HandModel) -> list[HandPose]:
    """Move the true poses of some frames into the axes of the cameras that took them."""
    return [
        pose_in_camera(
            HandPose(truth.theta[frame], truth.beta, truth.transl[frame], "right", truth.forearm[frame]),
            truth.cameras[frame],
            hand,
        )
        for frame in frames
    ]


def pose_in_camera(pose: HandPose, camera: Camera, hand: HandModel) -> HandPose:
    """Move a pose of the world into the axes of a camera."""
    motion = HandMotion(pose.theta[None], pose.beta, pose.transl[None])
    moved = transformed(motion, np.linalg.inv(camera.cam2world), rest_wrists(hand, pose.beta))
    return replace(moved.pose(0), forearm=pose.forearm)


def compared(avatar: Avatar, truth: Truth, hand: HandModel, beta: np.ndarray) -> list[SceneFigures]:
    """Render the kept scenes with a shape [10] and compare each with its true picture."""
    renderer = Renderer(avatar, hand, "cpu")
    posed = zip(truth.scenes(hand, truth.beta), truth.scenes(hand, beta), truth.pictures(), strict=True)
    return [_compared(renderer, true_shot, shot, picture) for true_shot, shot, picture in posed]


def _compared(renderer: Renderer, true_shot: Shot, shot: Shot, picture: np.ndarray) -> SceneFigures:
    hand, gain = renderer.hand, exposure_gain(picture)
    frame = renderer.render(shot)
    ours = exposed(np.concatenate([frame.rgb, frame.alpha[..., None]], -1), gain)
    true = exposed(picture.astype(np.float32), gain)
    on_hand = hand_pixels(true_shot, hand) & (picture[..., 3] > 0.5)
    maps = surface_maps(true_shot, hand)
    seen = _is_seen(renderer.avatar, maps.uv)
    mm_per_px = 1000 * float(np.median(maps.depth[on_hand])) / true_shot.camera.K[0, 0]
    sides = {"seen": on_hand & seen, "unseen": on_hand & ~seen}
    contrast = {name: contrast_ratios(ours, true, side, mm_per_px) for name, side in sides.items()}
    pixels = {name: int(side.sum()) for name, side in sides.items()}
    return SceneFigures(picture_figures(ours, true, on_hand), contrast, pixels)


def hand_pixels(shot: Shot, hand: HandModel) -> np.ndarray:
    """Find the pixels [H, W] that show the hand and not its arm."""
    arm = vertex_map(shot, hand, hand.arm_weights)
    return np.nan_to_num(arm, nan=1.0) < _ARM


def _is_seen(avatar: Avatar, uv: np.ndarray) -> np.ndarray:
    """Look up where pixels [H, W] show skin that the person's pictures showed; all, where the avatar does not say."""
    arrays = {} if avatar.surface is None else avatar.surface.arrays
    if "confidence" not in arrays:
        return np.ones(uv.shape[:2], bool)
    confidence = arrays["confidence"]
    column, row = (np.clip((uv[..., axis] * len(confidence)).astype(int), 0, len(confidence) - 1) for axis in (0, 1))
    return confidence[row, column] >= _SEEN


def own_beta(avatar: Avatar) -> np.ndarray:
    """Return the shape [10] of an avatar's person; of nobody in particular where it has none."""
    return np.zeros(10) if avatar.surface is None else np.array(avatar.surface.person.beta)


def resized(image: np.ndarray, size_px: int) -> np.ndarray:
    """Halve or double a map [A, A, ...] until it has this size: means, or texels repeated.

    Raises:
        LiveHandError: no power of two lies between the sizes.
    """
    while len(image) > size_px and len(image) % 2 == 0:
        image = (image[::2, ::2] + image[1::2, ::2] + image[::2, 1::2] + image[1::2, 1::2]) / 4
    while len(image) < size_px:
        image = image.repeat(2, 0).repeat(2, 1)
    if len(image) != size_px:
        raise LiveHandError(f"the map must be a power of two times {size_px} texels wide or narrow, got {len(image)}")
    return image


def _say(line: str) -> None:
    sys.stdout.write(line + "\n")


if __name__ == "__main__":
    main()
