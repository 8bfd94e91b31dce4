"""`livehand render` of a pose file, without Blender: PNGs or EXRs with alpha of the hand alone, from the front.

A relightable avatar is in a studio's light. The wrist rotates as in the file and does not move. A file in a camera's
axes is seen from that camera; a take in a world's axes is turned by half a turn where the camera would see the stump.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ..batch.content_credentials import sign_file, signing_key
from ..batch.progress import FrameProgress, ShotOpened
from ..batch.report import RunReport
from ..geometry.framing import fitting_camera
from ..geometry.rotation import axis_angle_to_matrix
from ..hand.model import HandModel, upright
from ..hand.model_file import DEFAULT_HAND, load_hand_model
from ..motion.files.import_options import ImportOptions, motion_and_warning, with_options
from ..motion.files.open_files import open_motion_file
from ..motion.landmarks.picture_camera import PictureCamera
from ..motion.motion import HandMotion
from ..motion.spaces import rest_wrists, to_blender, transformed
from ..records.errors import LiveHandError
from ..records.shot import Shot
from ..records.side import SIDES
from ..system.command import parse_size_px, warn
from .origin import origin_facts, origin_text

_FRONT = (0.0, -1.0, 0.0)
_AWAY = 0.5  # sine of the angle out of the picture's plane beyond which a palm points away
_MIDDLE_KNUCKLE = 4
_FILL = 0.92  # share of the image that the hand fills
_SIZE_PX = (512, 512)
_FRAMES_FOR_CAMERA = 200


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `livehand render` that apply to pose files only."""
    parser.add_argument("--side", choices=SIDES, help="pose files: the hand to read, or which hand it really is")
    parser.add_argument("--hand", type=Path, metavar="FILE", help="pose files: the hand model (default: built-in)")
    parser.add_argument(
        "--mano", type=Path, metavar="FILE", help="pose files: MANO's file, where poses count from its mean"
    )
    parser.add_argument(
        "--identity", metavar="NAME", help="pose files: whom an avatar of several people shows (default: the first)"
    )
    parser.add_argument(
        "--picture",
        type=parse_picture_camera,
        metavar="WxH@DEG",
        help="landmarks in a picture: its size, px, and its camera's horizontal angle of view, such as 1280x720@60",
    )


def parse_picture_camera(text: str) -> PictureCamera:
    """Parse `1280x720@60` as the camera of a tracked picture, an argument's type."""
    size, _, angle = text.partition("@")
    try:
        return PictureCamera(parse_size_px(size, smallest=1), float(angle))
    except (ValueError, LiveHandError) as error:
        raise argparse.ArgumentTypeError(
            f"must be WIDTHxHEIGHT@DEGREES, such as 1280x720@60, got {text!r} ({error})"
        ) from error


def run(args: argparse.Namespace, read: Callable[[Path, HandModel], HandMotion] | None = None) -> dict[str, Any]:
    """Render the poses of the one file in `args.shots`, with the other arguments of `livehand render`.

    Args:
        args: of the command.
        read: reads the file's motion upright; None: as `posed_upright` does.

    Raises:
        LiveHandError: the file cannot be read, lacks the frames, or is not the only one.
    """
    if len(args.shots) > 1 or args.jobs > 1 or args.chunk.count > 1:
        raise LiveHandError("a pose file is rendered alone and in one piece; give one file, and no --jobs or --chunk")
    (path,) = args.shots
    from ..avatars.file import load_avatar
    from ..avatars.identities import of_identity
    from ..avatars.library import shipped_avatar_path
    from ..avatars.origin import frame_payload, read_origin
    from ..hand.lbs import posed_vertices
    from ..image.frame_writer import FileWriter
    from ..image.watermark.embedding import watermarked
    from ..render.renderer import Renderer
    from ..render.studio_light import studio_light

    avatar, origin = load_avatar(args.avatar), read_origin(args.avatar or shipped_avatar_path())
    if args.identity:
        avatar = of_identity(avatar, args.identity)
    hand = load_hand_model(args.hand or DEFAULT_HAND)
    if read is None:
        options = ImportOptions({"side": args.side} if args.side else {}, args.mano, picture_camera=args.picture)
        motion, first = posed_upright(path, hand, options, args.hand)
    else:
        motion, first = read(path, hand), 0
    frames = frame_indices(motion, args.frames, first)
    payload = frame_payload([origin], args.watermark)
    kinds, signing, text = args.format or ("png",), signing_key(args), origin_text([origin])
    if signing is not None and "png" not in kinds:
        raise LiveHandError(f"frames are signed as PNG, got --format {','.join(kinds)}; add png, or do not sign")
    sign = None if signing is None else partial(sign_file, signing=signing, origin=origin_facts([origin]))
    renderer = Renderer(avatar, hand, args.device or "auto", args.precision or "fp32")
    args.output.mkdir(parents=True, exist_ok=True)
    camera = fitting_camera(sampled_vertices(motion, frames, hand), _FRONT, args.size or _SIZE_PX, _FILL)
    light, report = studio_light(), RunReport({path: args.output}, args.output, args.json)
    report.add(path, ShotOpened(str(args.output), len(frames)))
    with FileWriter() as writer:
        for number, index in enumerate(frames, 1):
            started, pose = time.perf_counter(), motion.pose(index)
            frame = renderer.render(Shot(pose, posed_vertices(hand, pose), camera, light))
            if payload is not None:
                frame = replace(frame, rgb=watermarked(frame.rgb, frame.alpha, payload))

            def written(place: tuple[int, int] = (first + index + 1, number), started: float = started) -> None:
                seconds = time.perf_counter() - started
                report.add(path, FrameProgress(*place, len(frames), "written", seconds))

            for kind in kinds:
                path_of_frame = args.output / f"{first + index + 1:04d}.{kind}"
                then, seal = written if kind == kinds[-1] else _nothing, sign if kind == "png" else None
                writer.write(frame, path_of_frame, then, text, seal)
    return report.result()


def _nothing() -> None:
    """Do nothing."""


def posed_upright(
    path: Path, hand: HandModel, options: ImportOptions | None = None, hand_path: Path | None = None
) -> tuple[HandMotion, int]:
    """Read a file's motion into Blender's world, its wrist at the origin; a hand in its own space stands upright.

    Returns the motion, and how many frames of the file are before its first.

    Raises:
        LiveHandError: the file is unreadable, or MANO's file is needed and missing.
    """
    options = options or ImportOptions()
    file = with_options(open_motion_file(path), options)
    motion, doubt = motion_and_warning(file, options, hand, hand_path)
    if doubt:
        warn(f"livehand render: {path}: check the motion: {doubt}")
    matrix = to_blender(file.info.space)
    if file.info.space == "hand":
        matrix[:3, :3] = upright(motion.side)
    model = hand.for_side(motion.side)
    wrists = rest_wrists(model, motion.betas)
    motion = transformed(motion, matrix, wrists)
    if file.info.space in ("y_up", "z_up") and _points_away(motion, model):
        motion = transformed(motion, np.diag([-1.0, -1, 1, 1]), wrists)
    return replace(motion, transl=-wrists), file.info.first


def _points_away(motion: HandMotion, model: HandModel) -> bool:
    """Tell whether the camera would look at the stump: in the mean of all poses the palm points away from it.

    So do the takes of headsets, whose wearers see the backs of their hands.
    """
    palm = axis_angle_to_matrix(motion.theta[:, 0]) @ (model.joints[_MIDDLE_KNUCKLE] - model.joints[0])
    mean = palm.mean(0)
    return bool(-mean @ _FRONT > _AWAY * np.linalg.norm(palm, axis=-1).mean())


def frame_indices(motion: HandMotion, frames: Sequence[int] | None, first: int = 0) -> list[int]:
    """Select indices of the requested frames of the file, which count from 1; all if None.

    Args:
        motion: of the file's frames from the one after `first` on.
        frames: of the file.
        first: how many frames of the file are before the motion.

    Raises:
        LiveHandError: the motion lacks a frame.
    """
    if frames is None:
        return list(range(len(motion)))
    missing = [frame for frame in frames if not first < frame <= first + len(motion)]
    if missing:
        span = f"{first + 1}-{first + len(motion)}"
        raise LiveHandError(f"frames must lie in {span}, as the hand's in the file do, got {missing[:5]}")
    return [frame - first - 1 for frame in frames]


def sampled_vertices(motion: HandMotion, frames: list[int], hand: HandModel) -> np.ndarray:
    """Sample vertices [N, 3] m of the hand without its arm, in at most 200 evenly spaced frames, for framing."""
    from ..hand.lbs import posed_vertices

    step = -(-len(frames) // _FRAMES_FOR_CAMERA)
    poses = (motion.pose(index) for index in frames[:: max(1, step)])
    return np.concatenate([posed_vertices(hand, pose)[hand.framed_vertices] for pose in poses])
