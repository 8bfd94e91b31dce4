"""Where pictures come from: a film, photographs, or a capture whose poses are known."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from ..hand.model import HandModel
from ..records.errors import LiveHandError
from ..records.hand_picture import PicturedHand
from ..records.side import Side
from .kept_steps import PICTURED_HAND, KeptSteps

FILM_SUFFIXES = (".mp4", ".mov", ".m4v", ".mkv", ".avi", ".webm", ".mts", ".ts")
_MOST_PICTURES = 40


@dataclass(frozen=True)
class PictureSource:
    """What the pictures are read from.

    Attributes:
        path: of a film, a folder of photographs, or a capture.
        side: of the hand; None: the one seen longer.
        weights: folder of the tracker; None: the user's own.
        other: the hand model of a capture's poses; None: the built-in one.
        fov_deg: the camera's angle of view, horizontal of a film, along the longer side of photographs that do not
            tell it; None: usual ones.
    """

    path: Path
    side: Side | None = None
    weights: Path | None = None
    other: HandModel | None = None
    fov_deg: float | None = None


def pictured_hand(
    source: PictureSource, model: HandModel, log: Callable[[str], None], steps: KeptSteps | None = None
) -> PicturedHand:
    """Read pictures of a hand from whatever the source is.

    Args:
        source: of the pictures.
        model: the built-in hand.
        log: is told what begins.
        steps: where results are kept; None: nowhere.

    Raises:
        LiveHandError: there is nothing, no hand, or no hand that is good enough.
    """
    steps = steps or KeptSteps()
    return steps.kept("pictures", partial(_pictured_hand, source, model, log, steps), PICTURED_HAND)


def _pictured_hand(
    source: PictureSource, model: HandModel, log: Callable[[str], None], steps: KeptSteps
) -> PicturedHand:
    from .rig.calibration import has_cameras

    path, side, fov_deg = source.path, source.side, source.fov_deg
    if source.fov_deg is not None and ((path / "transforms.json").is_file() or has_cameras(path)):
        raise LiveHandError(f"--fov is of a film or of photographs, the cameras of {path} are known; leave it out")
    if (path / "transforms.json").is_file():
        from .captured_pictures import pictures_of_capture

        captured = pictures_of_capture(path, model, _MOST_PICTURES, source.other, log)
        if side not in (None, captured.side):
            raise LiveHandError(f"--side must be that of the capture, {captured.side}, got {side}; leave it out")
        return captured
    if source.other is not None:
        raise LiveHandError(f"--hand is the hand model of a capture's poses, {path} is no capture; leave it out")
    from ..tracking.weights import load_networks
    from .camera_gains import with_camera_gains
    from .rig.pictures_of_rig import pictures_of_rig

    if has_cameras(path):
        hands = pictures_of_rig(path, networks=load_networks(source.weights), model=model, say=log)
        return _hand_of_rig(with_camera_gains(hands, model), side)

    if path.is_file() and path.suffix.lower() in FILM_SUFFIXES:
        from .film import pictures_of_film

        return pictures_of_film(path, model, log, side, _MOST_PICTURES, load_networks(source.weights), steps, fov_deg)
    if path.is_dir():
        from .photographs import pictures_of_photographs

        return pictures_of_photographs(path, model, log, side, load_networks(source.weights), fov_deg)
    raise LiveHandError(
        f"{path} must be a film ({', '.join(FILM_SUFFIXES)}), a folder of photographs (.jpg, .png), pictures of "
        "calibrated cameras (with cameras.json) or a capture (with transforms.json); check the path"
    )


def _hand_of_rig(hands: Mapping[Side, PicturedHand], side: Side | None) -> PicturedHand:
    """Choose a hand: the wanted one, or the one that more cameras show."""
    if side is not None and side not in hands:
        raise LiveHandError(f"--side must name a hand that the cameras show, got {side}; they show {', '.join(hands)}")
    return hands[side] if side else max(hands.values(), key=lambda hand: len(hand.pictures))
