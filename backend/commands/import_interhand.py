"""`livehand import-interhand`: its arguments and its run. Torch is imported only when it runs."""

from __future__ import annotations

import argparse
from dataclasses import fields
from functools import partial
from pathlib import Path

from ..system.command import Command, parse_count, warn


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("root", type=Path, help="the data set's folder, which contains images/SPLIT/CaptureN")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="CAPTURE", help="folder to write")
    parser.add_argument("--hand", type=Path, required=True, help="MANO's right hand (MANO_RIGHT.pkl)")
    parser.add_argument("--annotations", type=Path, metavar="DIR", help="default: ROOT/annotations")
    parser.add_argument("--split", choices=("train", "val", "test"), default="test", help="of the data set")
    parser.add_argument("--capture", type=int, required=True, metavar="N", help="one capture is one subject")
    parser.add_argument("--sequences", nargs="+", metavar="NAME", help="default: all")
    parser.add_argument("--cameras", nargs="+", metavar="ID", help="default: all colour cameras")
    parser.add_argument("--every", type=parse_count, default=1, metavar="N", help="import only each N-th frame")
    parser.add_argument(
        "--shape",
        choices=("per-frame", "mean", "median"),
        default="per-frame",
        help="the fits' shapes, which differ between frames, or one shape for all (default: %(default)s)",
    )
    parser.add_argument("--split-file", type=Path, metavar="FILE", help="hold out the frames and cameras in this file")
    parser.add_argument(
        "--held-out-frames",
        type=partial(parse_count, smallest=0),
        default=50,
        metavar="N",
        help="hold out the last N, as in the paper (default: %(default)s)",
    )
    parser.add_argument(
        "--held-out-cameras",
        nargs="*",
        metavar="ID",
        help="default: every tenth by id, from the fifth; no ids: none",
    )


def _run(args: argparse.Namespace) -> dict:
    from ..capture.importers.interhand_capture import InterHandRequest, import_interhand
    from ..hand.model_file import load_hand_model, load_hands_mean
    from ..motion.capture_gate import imported_doubt

    args.annotations = args.annotations or args.root / "annotations"
    request = InterHandRequest(**{field.name: getattr(args, field.name) for field in fields(InterHandRequest)})
    hand, mean = load_hand_model(args.hand, "right"), load_hands_mean(args.hand)
    result = import_interhand(request, hand, mean, args.output)
    doubt = imported_doubt(result.capture, hand, mean)
    if doubt:
        warn(f"livehand import-interhand: {args.output}: check the poses: {doubt}")
    images, poses = len(result.capture.views), len(result.capture.poses)
    return {
        "capture": str(args.output),
        "images": images,
        "poses": poses,
        "grey_images": result.grey_images,
        "unfitted_frames": result.unfitted_frames,
        "check": doubt,
        "summary": f"{args.output}: {images} images of {poses} poses; skipped: {result.grey_images} grey images, "
        f"{result.unfitted_frames} frames without a fit. Next: livehand mask {args.output} --hand {args.hand}",
    }


COMMAND = Command("import-interhand", "make a capture of images from InterHand2.6M", _add_arguments, _run)
