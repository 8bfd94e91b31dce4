"""`livehand import-interhand`: arguments, and the call. What needs torch is imported when it runs."""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

from ...runtime.command import Command, parse_count


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("root", type=Path, help="the data set's folder, which holds images/SPLIT/CaptureN")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="CAPTURE", help="folder to write")
    parser.add_argument("--hand", type=Path, required=True, help="MANO's right hand (MANO_RIGHT.pkl)")
    parser.add_argument("--annotations", type=Path, metavar="DIR", help="default: ROOT/annotations")
    parser.add_argument("--split", choices=("train", "val", "test"), default="test", help="of the data set")
    parser.add_argument("--capture", type=int, required=True, metavar="N", help="one capture is one subject")
    parser.add_argument("--sequences", nargs="+", metavar="NAME", help="default: all")
    parser.add_argument("--cameras", nargs="+", metavar="ID", help="default: all that see colour")
    parser.add_argument("--every", type=parse_count, default=1, metavar="N", help="each N-th frame only")
    parser.add_argument(
        "--shape",
        choices=("per-frame", "mean", "median"),
        default="per-frame",
        help="the fits' own shapes, which differ from frame to frame, or one for all frames (default: %(default)s)",
    )
    parser.add_argument("--split-file", type=Path, metavar="FILE", help="hold out what this file says")
    parser.add_argument(
        "--held-out-frames",
        type=partial(parse_count, smallest=0),
        default=50,
        metavar="N",
        help="the last N, as in the paper (default: %(default)s)",
    )
    parser.add_argument(
        "--held-out-cameras",
        nargs="*",
        metavar="ID",
        help="default: every tenth by id, from the fifth; without ids: none",
    )


def _run(args: argparse.Namespace) -> dict:
    from ...hand.model_file import load_hand_model, load_hands_mean
    from .interhand_capture import InterHandRequest, import_interhand

    request = InterHandRequest(
        root=args.root,
        annotations=args.annotations or args.root / "annotations",
        split=args.split,
        capture=args.capture,
        sequences=args.sequences,
        cameras=args.cameras,
        shape=args.shape,
        split_file=args.split_file,
        held_out_frames=args.held_out_frames,
        held_out_cameras=args.held_out_cameras,
        every=args.every,
    )
    hand, mean = load_hand_model(args.hand, "right"), load_hands_mean(args.hand)
    result = import_interhand(request, hand, mean, args.output)
    images, poses = len(result.capture.views), len(result.capture.poses)
    return {
        "capture": str(args.output),
        "images": images,
        "poses": poses,
        "grey_images": result.grey_images,
        "unfitted_frames": result.unfitted_frames,
        "summary": f"{args.output}: {images} images of {poses} poses; left out: {result.grey_images} grey images, "
        f"{result.unfitted_frames} frames without a fit. Next: livehand mask {args.output} --hand {args.hand}",
    }


COMMAND = Command("import-interhand", "make a capture of InterHand2.6M's images", _add_arguments, _run)
