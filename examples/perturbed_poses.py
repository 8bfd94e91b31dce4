"""What refinement is worth: a capture whose training poses are wrong by a known amount, trained with and without it.

    python examples/perturbed_poses.py worsen capture worse --degrees 1 --millimetres 2
    livehand train worse -o off.safetensors
    livehand train worse -o on.safetensors --refine            # writes on.refined beside it, with the refined poses
    python examples/perturbed_poses.py compare capture worse on.refined
    livehand evaluate capture --avatar off.safetensors --split all
    livehand evaluate capture --avatar on.safetensors --split all

Held-out poses stay true, so evaluation measures the avatars alone.
"""

import argparse
from pathlib import Path

from livehand.backend.captures.capture import load_capture
from livehand.backend.hand.model_file import load_default_hand, load_hand_model
from livehand.backend.training.pose_noise import pose_error, with_noise
from livehand.backend.training.refined_capture import save_by_reference


def worsen(args):
    capture = load_capture(args.capture)
    save_by_reference(with_noise(capture, args.degrees, args.millimetres, args.seed), args.output)


def compare(args):
    truth = load_capture(args.truth)
    hand = load_hand_model(args.hand) if args.hand else load_default_hand()
    trained = sorted({view.pose_index for view in truth.of_split("train")})
    print(f"{'rms of training poses':24} {'angles, deg':>12} {'place, mm':>12} {'vertices, mm':>14}")
    for folder in args.captures:
        error = pose_error(load_capture(folder).poses, truth.poses, trained, hand)
        print(f"{str(folder)[-24:]:24} {error.theta_deg:12.3f} {error.transl_mm:12.3f} {error.vertex_mm:14.3f}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    verbs = parser.add_subparsers(required=True)
    make = verbs.add_parser("worsen", help="write a capture with wrong training poses; its images are the first one's")
    make.add_argument("capture", type=Path)
    make.add_argument("output", type=Path)
    make.add_argument("--degrees", type=float, default=1.0, help="rms length of each joint's axis-angle error")
    make.add_argument("--millimetres", type=float, default=2.0, help="rms length of each place's error")
    make.add_argument("--seed", type=int, default=0)
    make.set_defaults(run=worsen)
    tell = verbs.add_parser("compare", help="how far captures' poses are from the true ones, but for a common offset")
    tell.add_argument("truth", type=Path)
    tell.add_argument("captures", type=Path, nargs="+")
    tell.add_argument("--hand", type=Path)
    tell.set_defaults(run=compare)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
