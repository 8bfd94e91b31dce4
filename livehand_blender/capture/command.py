"""`livehand capture`: arguments, and the call."""

from __future__ import annotations

import argparse
import hashlib
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from ...backend.captures.plan import CapturePlan
from ...backend.records.errors import LiveHandError
from ...backend.runtime.command import parse_size_px

if TYPE_CHECKING:
    from .render import DressedHand

_TONES = ("light", "deep")  # the names of `skin.SKIN_TONES`, which needs bpy
_SMALLEST_PX = 16  # of an image's sides: one bucket of the renderer's window


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    plan = CapturePlan()
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="the capture's folder")
    parser.add_argument("--hand", type=Path, help="a hand model of your own (livehand make-hand; default: built-in)")
    parser.add_argument(
        "--look",
        type=Path,
        metavar="BLEND",
        help="what --hand looks like (default: the .blend beside it; without one a plain skin)",
    )
    parser.add_argument("--seed", type=int, default=plan.seed, help="of poses and cameras (default: %(default)s)")
    parser.add_argument("--poses", type=int, default=plan.poses, help="how many, held-out ones included")
    parser.add_argument("--cameras", type=int, default=plan.cameras, help="how many, held-out ones included")
    parser.add_argument(
        "--cameras-per-pose", type=int, default=plan.cameras_per_pose, help="training cameras that see each pose"
    )
    parser.add_argument("--tone", choices=_TONES, default=plan.tone, help="of the skin (default: %(default)s)")
    parser.add_argument(
        "--size",
        type=partial(parse_size_px, smallest=_SMALLEST_PX),
        default=plan.size_px,
        metavar="WxH",
        help="image size, px",
    )
    parser.add_argument("--samples", type=int, default=plan.samples, help="Cycles samples per pixel, training views")
    parser.add_argument("--eval-samples", type=int, default=plan.eval_samples, help="the same, held-out views")
    parser.add_argument("--eval-views", type=int, default=plan.eval_views, help="views per held-out split, at most")
    parser.add_argument("--first-poses", type=int, default=plan.first_poses, help="render only so many of the poses")
    parser.add_argument("--threads", type=int, default=None, help="render threads (default: all)")


def run(args: argparse.Namespace) -> dict:
    """Render the capture; returns what was made."""
    from .render import render_capture

    plan = replace(
        CapturePlan(),
        seed=args.seed,
        poses=args.poses,
        cameras=args.cameras,
        cameras_per_pose=args.cameras_per_pose,
        tone=args.tone,
        size_px=args.size,
        samples=args.samples,
        eval_samples=args.eval_samples,
        eval_views=args.eval_views,
        first_poses=args.first_poses,
    )
    provenance = {"made_by": "livehand capture", "plan": asdict(plan)}
    own = _own_hand(args)
    if own is None:
        capture = render_capture(args.output, plan, provenance, args.threads)
    else:
        look_sha256 = hashlib.sha256(own.look.read_bytes()).hexdigest() if own.look else None
        provenance |= {"hand": own.model.name, "look_sha256": look_sha256}
        capture = render_capture(args.output, plan, provenance, args.threads, own)
    counts = {split: len(capture.of_split(split)) for split in ("train", "novel_pose", "novel_camera", "test")}
    return {"folder": str(args.output), "poses": len(capture.poses), "images": len(capture.views), **counts}


def _own_hand(args: argparse.Namespace) -> DressedHand | None:
    """The hand of --hand and --look, None for the built-in one."""
    from ...backend.hand.model_file import load_hand_model
    from .look import look_path
    from .render import DressedHand

    if args.hand is None:
        if args.look is not None:
            raise LiveHandError("--look is of a hand of your own; give that hand with --hand")
        return None
    look = args.look or look_path(args.hand)
    if args.look and not look.is_file():
        raise LiveHandError(f"no look at {look}; give the .blend that livehand make-hand has written")
    return DressedHand(load_hand_model(args.hand), look if look.is_file() else None)
