"""`livehand reenact`: a video's hands, replaced by avatars."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ...avatars.library import AVATAR_HELP, avatar_path
from ...records.errors import LiveHandError
from ...system.command import Command, parse_fov, warn
from ...system.files import replacing
from ...tracking.sighted_take import filmed_take, frames_of_film

_VIDEO_SUFFIXES = (".mp4", ".mkv", ".mov")


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("video", type=Path, help="the video")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="PATH", help="a video (.mp4), or a folder for PNGs"
    )
    parser.add_argument("--avatar", nargs="+", default=["light"], metavar="AVATAR", help=f"one or more: {AVATAR_HELP}")
    parser.add_argument("--side-by-side", action="store_true", help="the original beside the avatars")
    parser.add_argument(
        "--shutter",
        type=_parse_shutter,
        default=0.5,
        metavar="FRAMES",
        help="how long the shutter is open, for motion blur; 0: sharp (default: %(default)s)",
    )
    parser.add_argument("--fov", type=parse_fov, metavar="DEG", help="the camera's horizontal angle of view")
    parser.add_argument("--hand", type=Path, metavar="FILE", help="the avatars' hand model (default: built-in)")
    parser.add_argument("--device", default="auto", help="as in render (default: %(default)s)")


def _parse_shutter(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"must be a share of a frame from 0 to 1, got {text!r}")
    return value


def _run(args: argparse.Namespace) -> dict[str, Any]:
    from ...avatars.file import load_avatar
    from ...hand.model_file import DEFAULT_HAND, load_hand_model
    from ...motion.landmarks.take_file import take_doubts
    from ...render.renderer import Renderer
    from ...tracking.takes import track_frames
    from ...tracking.tracker import HandTracker
    from ...tracking.turning_hand.take_shape import fit_with_shape
    from ...tracking.video import open_video
    from ...tracking.weights import load_networks
    from .film_look import measured_look
    from .filmed_shots import FilmedShots
    from .reenactment import reenacted

    if args.output.suffix and args.output.suffix.lower() not in _VIDEO_SUFFIXES:
        raise LiveHandError(f"the output must be a folder or a video ({', '.join(_VIDEO_SUFFIXES)}), got {args.output}")
    avatars = [load_avatar(avatar_path(name)) for name in args.avatar]
    model = load_hand_model(args.hand or DEFAULT_HAND)
    renderers = [Renderer(avatar, model, args.device) for avatar in avatars]
    video = open_video(args.video)
    found = track_frames(frames_of_film(video), HandTracker(load_networks()))
    take = filmed_take(found, video.fps, args.fov, args.video)
    hands = []
    for side in take.hands:
        fit = fit_with_shape(take, side, model)
        if doubt := take_doubts(fit, model):
            warn(f"livehand reenact: check the {side} hand: {doubt}")
        hands.append(FilmedShots.of(fit, take.camera, model))
    look = measured_look(video.frames(), len(take.times), hands, renderers)
    pictures = reenacted(video.frames(), hands, renderers, look, args.side_by_side, args.shutter)
    count = _write(_shown(pictures, len(take.times)), args.output, take.times, video.fps)
    ground = "a clean plate" if look.plate is not None else "the footage itself, as its camera moves"
    return {
        "output": str(args.output),
        "frames": count,
        "has_plate": look.plate is not None,
        "summary": f"{args.output}: {count} frames over {ground}",
    }


def _shown(pictures: Iterator[np.ndarray], count: int) -> Iterator[np.ndarray]:
    from tqdm import tqdm

    yield from tqdm(pictures, total=count, unit="frame", disable=None)


def _write(pictures: Iterator[np.ndarray], output: Path, times: np.ndarray, fps: float) -> int:
    if output.suffix:
        from ...tracking.video_writer import write_video

        return write_video(pictures, output, times, fps)
    from PIL import Image

    output.mkdir(parents=True, exist_ok=True)
    count = 0
    for count, picture in enumerate(pictures, 1):
        with replacing(output / f"{count:04d}.png") as temporary:
            Image.fromarray(picture).save(temporary, format="PNG")
    return count


COMMAND = Command("reenact", "replace the hands in a video by avatars", _add_arguments, _run)
