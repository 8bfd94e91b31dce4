"""Measure pose refinement: train on a capture with known errors of its training poses, with and without refinement.

    python examples/perturbed_poses.py worsen capture worse --degrees 1 --millimetres 2
    livehand train worse -o off.safetensors
    livehand train worse -o on.safetensors --refine            # writes on.refined beside it, with the refined poses
    python examples/perturbed_poses.py compare capture worse on.refined
    livehand evaluate capture --avatar off.safetensors --split all
    livehand evaluate capture --avatar on.safetensors --split all

The held-out poses are unchanged, so evaluation compares only the avatars.
"""

import argparse
from pathlib import Path

from livehand.backend.capture.capture import load_capture
from livehand.backend.hand.model_file import load_default_hand, load_hand_model
from livehand.backend.research.comparison.misfit import pose_error, with_noise
from livehand.backend.training.refined_capture import save_by_reference


def worsen(args):
    capture = load_capture(args.capture)
    save_by_reference(with_noise(capture, args.degrees, args.millimetres, args.seed), args.output)


def compare(args):
    truth = load_capture(args.truth)
    hand = load_hand_model(args.hand) if args.hand else load_default_hand()
    trained = sorted({view.pose_index for view in truth.of_split("train")})
    print(f"{'rms of training poses':24} {'angles, deg':>12} {'location, mm':>12} {'vertices, mm':>14}")
    for folder in args.captures:
        error = pose_error(load_capture(folder).poses, truth.poses, trained, hand)
        print(f"{str(folder)[-24:]:24} {error.theta_deg:12.3f} {error.transl_mm:12.3f} {error.vertex_mm:14.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    worsened = commands.add_parser("worsen", help="write a capture with perturbed training poses and the same images")
    worsened.add_argument("capture", type=Path)
    worsened.add_argument("output", type=Path)
    worsened.add_argument("--degrees", type=float, default=1.0, help="rms length of each joint's axis-angle error")
    worsened.add_argument("--millimetres", type=float, default=2.0, help="rms length of each location's error")
    worsened.add_argument("--seed", type=int, default=0)
    worsened.set_defaults(run=worsen)
    compared = commands.add_parser("compare", help="print pose errors of captures, without a common offset")
    compared.add_argument("truth", type=Path)
    compared.add_argument("captures", type=Path, nargs="+")
    compared.add_argument("--hand", type=Path)
    compared.set_defaults(run=compare)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
