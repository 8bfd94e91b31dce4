"""`livehand import-transforms`: its arguments and its run. Torch is imported only when it runs."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

from ..records.errors import LiveHandError
from ..system.command import Command, warn


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("transforms", type=Path, help="a transforms.json in nerfstudio's format")
    parser.add_argument("--poses", type=Path, required=True, help=".npz with theta, beta, transl and optionally time")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="CAPTURE", help="folder to write")
    parser.add_argument("--hand", type=Path, help="the hand model of the poses (default: the built-in hand)")
    parser.add_argument("--add-hands-mean", action="store_true", help="add the hand model's mean pose to the fingers")
    parser.add_argument(
        "--metres-per-unit", type=float, default=1.0, help="of the camera positions (default: %(default)s)"
    )
    parser.add_argument(
        "--held-out-poses", type=int, nargs="*", metavar="I", help="default: the last tenth; no numbers: none"
    )
    parser.add_argument(
        "--held-out-cameras", type=int, nargs="*", metavar="I", help="default: every eighth; no numbers: none"
    )
    parser.add_argument(
        "--held-out-lights", type=int, nargs="*", metavar="I", help="default: every eighth; no numbers: none"
    )
    parser.add_argument(
        "--allow-outside", action="store_true", help="also copy files that lie outside the folder of transforms.json"
    )


def _run(args: argparse.Namespace) -> dict:
    from ..capture.importers.transforms import read_pose_table
    from ..capture.importers.transforms_capture import import_transforms
    from ..hand.model_file import builtin_hand_path, load_hand_model, load_hands_mean
    from ..motion.capture_gate import imported_doubt

    if not args.metres_per_unit > 0:
        raise LiveHandError(f"--metres-per-unit must be above 0, got {args.metres_per_unit}")
    path = args.hand or builtin_hand_path()
    mean, hand = load_hands_mean(path) if args.add_hands_mean else None, load_hand_model(path)
    poses = read_pose_table(args.poses, mean)
    capture = import_transforms(
        args.transforms,
        poses,
        hand,
        args.output,
        args.metres_per_unit,
        args.held_out_poses,
        args.held_out_cameras,
        args.held_out_lights,
        args.allow_outside,
    )
    doubt = imported_doubt(capture, hand, mean, poses.times)
    if doubt:
        warn(f"livehand import-transforms: {args.output}: check the poses: {doubt}")
    splits = dict(Counter(view.split for view in capture.views))
    return {
        "capture": str(args.output),
        "images": len(capture.views),
        "poses": len(capture.poses),
        "splits": splits,
        "check": doubt,
    }


COMMAND = Command("import-transforms", "make a capture of a transforms.json and poses", _add_arguments, _run)
