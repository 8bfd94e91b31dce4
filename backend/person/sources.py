"""Where pictures come from: a film, photographs, or a capture whose poses are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from ..capture.capture import Capture, CaptureView, load_capture
from ..capture.picture import linear_to_srgb, straight
from ..hand.model import HandModel
from ..records.errors import LiveHandError
from ..records.hand_picture import BACKGROUND, HAND, UNKNOWN, HandPicture, PicturedHand
from ..records.side import Side

FILM_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".mts", ".ts")
_MOST_PICTURES = 40
_SURE_HAND, _SURE_BACKGROUND = 0.75, 0.25  # of alpha


def pictured_hand(
    source: Path, model: HandModel, side: Side | None, weights: Path | None, log: Callable[[str], None]
) -> PicturedHand:
    """Read pictures of a hand from whatever the source is.

    Raises:
        LiveHandError: there is nothing, no hand, or no hand that is good enough.
    """
    if (source / "transforms.json").is_file():
        captured = pictures_of_capture(source, model, _MOST_PICTURES)
        if side not in (None, captured.side):
            raise LiveHandError(f"--side must be that of the capture, {captured.side}, got {side}; leave it out")
        return captured
    from ..tracking.weights import load_networks
    from .rig.calibration import has_cameras
    from .rig.pictures_of_rig import pictures_of_rig

    if has_cameras(source):
        return _hand_of_rig(pictures_of_rig(source, networks=load_networks(weights), model=model, say=log), side)

    if source.is_file() and source.suffix.lower() in FILM_SUFFIXES:
        from .film import pictures_of_film

        return pictures_of_film(source, model, log, side, _MOST_PICTURES, load_networks(weights))
    if source.is_dir():
        from .photographs import pictures_of_photographs

        return pictures_of_photographs(source, model, log, side, load_networks(weights))
    raise LiveHandError(
        f"{source} must be a film ({', '.join(FILM_SUFFIXES)}), a folder of photographs (.jpg, .png), pictures of "
        "calibrated cameras (with cameras.json) or a capture (with transforms.json); check the path"
    )


def _hand_of_rig(hands: Mapping[Side, PicturedHand], side: Side | None) -> PicturedHand:
    """Choose a hand: the wanted one, or the one that more cameras show."""
    if side is not None and side not in hands:
        raise LiveHandError(f"--side must name a hand that the cameras show, got {side}; they show {', '.join(hands)}")
    return hands[side] if side else max(hands.values(), key=lambda hand: len(hand.pictures))


def pictures_of_capture(folder: Path, model: HandModel, most: int) -> PicturedHand:
    """Read the pictures of a capture; its held-out poses are held out here.

    Args:
        folder: of the capture.
        model: the hand that a person is made on.
        most: pictures of each split, evenly chosen.

    Raises:
        LiveHandError: the capture is broken, of another hand, or of a left one.
    """
    capture = load_capture(folder)
    if capture.hand_sha256 != model.sha256:
        raise LiveHandError(
            f"{folder} must be a capture of '{model.name}', got one of hand {capture.hand_sha256[:12]}...; "
            "make it again with the built-in hand (livehand track FILM --capture DIR without --hand)"
        )
    train = _spread(capture.of_split("train"), most)
    if not train:
        raise LiveHandError(f"{folder} must have images to make a person from (split train), got none")
    held_out = _spread(capture.of_split("novel_pose"), max(1, most // 6))
    pictures = [
        _picture(capture, view, is_held_out)
        for views, is_held_out in ((train, False), (held_out, True))
        for view in views
    ]
    is_mirrored = capture.provenance.get("is_mirrored") is True
    return PicturedHand(tuple(pictures), "left" if is_mirrored else "right", folder.name)


def _spread(views: tuple[CaptureView, ...], most: int) -> list[CaptureView]:
    return [views[index] for index in np.linspace(0, len(views) - 1, min(most, len(views))).round().astype(int)]


def _picture(capture: Capture, view: CaptureView, is_held_out: bool) -> HandPicture:
    if view.is_linear:
        linear = capture.read_linear(view)
        alpha, rgb = linear[..., 3], linear_to_srgb(straight(linear).clip(0, 1))
        encoded = (255 * rgb).round().astype(np.uint8)
    else:
        pixels = capture.read_pixels(view)
        alpha, encoded = pixels[..., 3] / 255, pixels[..., :3]
    labels = np.full(alpha.shape, UNKNOWN, np.uint8)
    labels[alpha > _SURE_HAND], labels[alpha < _SURE_BACKGROUND] = HAND, BACKGROUND
    pose = capture.poses[view.pose_index]
    scene = 0 if view.light is None else view.light
    return HandPicture(view.file, encoded, labels, view.camera, pose, view.camera_index, scene, is_held_out)
