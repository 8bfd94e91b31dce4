"""`livehand render` of a pose file, without Blender: the hand alone, from the front, as PNGs with alpha.

The wrist stays where it is and turns as in the file. A file in a camera's axes is seen from that camera.
"""

from __future__ import annotations

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..geometry.framing import fitting_camera
from ..hand.model import HandModel, upright
from ..hand.model_file import load_default_hand, load_hand_model
from ..motion.landmarks.landmark_file import LandmarkFile
from ..motion.mano_basis import ManoBasis, find_basis
from ..motion.motion import HandMotion
from ..motion.open_files import open_motion_file
from ..motion.spaces import rest_wrists, to_blender, transformed
from ..records.camera import Camera
from ..records.errors import LiveHandError
from ..records.shot import SIDES, Shot
from ..runtime.command import say

if TYPE_CHECKING:
    from ..records.shot import Frame
    from ..rendering.renderer import Renderer

_FRONT = (0.0, -1.0, 0.0)
_FILLED = 0.92  # of the picture
_SIZE_PX = (512, 512)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What a pose file asks for beyond the arguments of `livehand render`."""
    parser.add_argument("--side", choices=SIDES, help="of a pose file: which of its hands, or which hand it really is")
    parser.add_argument("--hand", type=Path, metavar="FILE", help="of a pose file: the hand model (default: built-in)")
    parser.add_argument("--mano", type=Path, metavar="FILE", help="MANO's file, for poses that count from its mean")


def run(args: argparse.Namespace) -> dict[str, Any]:
    """Render the poses of the one file in `args.shots`; takes the namespace of `livehand render`.

    Raises:
        LiveHandError: the file cannot be read, the frames asked for are not in it, or it is not the only one.
    """
    if len(args.shots) > 1 or args.jobs > 1 or args.chunk.count > 1:
        raise LiveHandError("a pose file is rendered alone and in one piece; give one file, and no --jobs or --chunk")
    (path,) = args.shots
    from ..avatars.file import load_avatar
    from ..rendering.renderer import Renderer

    hand = load_hand_model(args.hand) if args.hand else load_default_hand()
    motion = posed_upright(path, hand, args.side, find_basis(args.mano, args.hand))
    frames = chosen_frames(motion, args.frames)
    renderer = Renderer(load_avatar(args.avatar), hand, args.device or "auto", args.precision or "fp32")
    args.output.mkdir(parents=True, exist_ok=True)
    camera = fitting_camera(reach(motion, frames, hand), _FRONT, args.size or _SIZE_PX, _FILLED)
    started = time.perf_counter()
    for number, index in enumerate(frames, 1):
        write_png(_rendered(renderer, motion, index, hand, camera), args.output / f"{index + 1:04d}.png")
        say(f"frame {index + 1} ({number}/{len(frames)})")
    seconds = (time.perf_counter() - started) / len(frames)
    return {
        "folder": str(args.output),
        "frames": len(frames),
        "seconds_per_frame": round(seconds, 3),
        "summary": f"{args.output}: {len(frames)} frames, {seconds:.2f} s/frame",
    }


def posed_upright(path: Path, hand: HandModel, side: str | None = None, basis: ManoBasis | None = None) -> HandMotion:
    """A file's motion in Blender's world, the wrist at the origin; one in the hand's own space stands upright.

    Raises:
        LiveHandError: unreadable, or MANO's file is needed.
    """
    file = open_motion_file(path)
    file = file if side is None else file.with_changes(side=side)
    if isinstance(file, LandmarkFile):
        motion = file.motion(hand)
    else:
        motion = file.motion(basis)
    matrix = to_blender(file.info.space)
    if file.info.space == "hand":
        matrix[:3, :3] = upright(motion.side)
    wrists = rest_wrists(hand.for_side(motion.side), motion.betas)
    return replace(transformed(motion, matrix, wrists), transl=-wrists)


def chosen_frames(motion: HandMotion, frames: tuple[int, ...] | None) -> list[int]:
    """Indices of the frames asked for, which count from 1; None: all.

    Raises:
        LiveHandError: one of them is not there.
    """
    if frames is None:
        return list(range(len(motion)))
    missing = [frame for frame in frames if not 1 <= frame <= len(motion)]
    if missing:
        raise LiveHandError(f"frames must lie in 1-{len(motion)}, as the file's do, got {missing[:5]}")
    return [frame - 1 for frame in frames]


def reach(motion: HandMotion, frames: list[int], hand: HandModel) -> np.ndarray:
    """[N, 3] m: vertices of the hand in all frames, or in enough of them to see how far it reaches."""
    return np.concatenate([_vertices(motion, index, hand) for index in _spread(frames)])


def write_png(frame: Frame, path: Path) -> None:
    """Write a frame as sRGB with straight alpha; the file is whole or not there."""
    from PIL import Image

    from ..rendering.decode import straight_srgb

    partial = path.with_suffix(".partial")
    Image.fromarray((straight_srgb(frame) * 255).round().astype(np.uint8)).save(partial, format="PNG")
    os.replace(partial, path)


def _rendered(renderer: Renderer, motion: HandMotion, index: int, hand: HandModel, camera: Camera) -> Frame:
    return renderer.render(Shot(motion.pose(index), _vertices(motion, index, hand), camera))


def _vertices(motion: HandMotion, index: int, hand: HandModel) -> np.ndarray:
    from ..hand.lbs import posed_vertices

    return posed_vertices(hand, motion.pose(index))


def _spread(frames: list[int], most: int = 200) -> list[int]:
    return frames[:: max(1, -(-len(frames) // most))]
