"""`livehand mask`: its arguments and its run. Torch and OpenCV are imported only when it runs."""

from __future__ import annotations

import argparse
from pathlib import Path
from statistics import fmean

from ...system.command import Command

_WORST = 5


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("capture", type=Path, help="the capture's folder")
    parser.add_argument("--hand", type=Path, help="the capture's hand model (default: the built-in hand)")
    parser.add_argument(
        "--from",
        dest="given",
        type=Path,
        metavar="DIR",
        help="use these masks, which have the images' names, and make none",
    )
    parser.add_argument("--redo", action="store_true", help="replace existing masks and alpha")
    parser.add_argument("--no-arm", action="store_true", help="end masks at the wrist, also of a model that has an arm")
    parser.add_argument(
        "--erode-mm", type=float, default=4.0, help="pixels deeper inside the mesh are hand (default: %(default)s)"
    )
    parser.add_argument(
        "--dilate-mm", type=float, default=12.0, help="pixels farther outside are background (default: %(default)s)"
    )


def _run(args: argparse.Namespace) -> dict:
    from ...hand.model_file import DEFAULT_HAND, load_hand_model
    from .mask import MaskConfig
    from .mask_capture import mask_capture

    hand = load_hand_model(args.hand or DEFAULT_HAND)
    config = MaskConfig(erode_mm=args.erode_mm, dilate_mm=args.dilate_mm, ends_at_wrist=args.no_arm)
    masked = mask_capture(args.capture, hand, config, args.given, args.redo)
    worst = sorted(masked, key=lambda view: view.overlap)[:_WORST]
    overlap = round(fmean(view.overlap for view in masked), 4) if masked else None
    lines = "".join(f"\n  {view.overlap:.3f}  {view.view.mask}" for view in worst)
    return {
        "masks": len(masked),
        "overlap": overlap,
        "worst": {view.view.mask: round(view.overlap, 4) for view in worst},
        "summary": f"{len(masked)} masks; mean overlap with the posed mesh {overlap}, least:{lines}"
        if masked
        else "every image has alpha or a mask; nothing to do",
    }


COMMAND = Command("mask", "mask the hand in a capture's images", _add_arguments, _run)
