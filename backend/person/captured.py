"""The pictures of a capture: of one's own rig whose poses are known, or of a film that `livehand track` has cut."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..capture.capture import Capture, CaptureView, load_capture
from ..capture.picture import linear_to_srgb, straight
from ..hand.model import HandModel
from ..records.errors import LiveHandError
from .picture import BACKGROUND, HAND, UNKNOWN, HandPicture, PicturedHand

_SURE_HAND, _SURE_BACKGROUND = 0.75, 0.25  # of alpha


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
