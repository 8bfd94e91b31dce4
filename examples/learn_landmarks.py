"""Makes takes of our own hand, tracks them, learns where the tracker sees its landmarks, and measures the fit.

    python examples/learn_landmarks.py --takes 12 --seed 100            # prints MEDIAPIPE_DEFINITION's millimetres
    python examples/learn_landmarks.py --takes 12 --seed 4242 --gates   # measures takes made anew with what ships

A take of 48 frames is rendered in about 12 s of one core.
"""

import argparse

import numpy as np
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.evaluation.takes import made_take, pictures, true_landmarks
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.posed_bones import bone_frames
from livehand.backend.motion.landmarks.camera_fit import at_nodes
from livehand.backend.motion.landmarks.definition import learnt_definition
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.motion.landmarks.take_fit import FilmCamera, FilmedHand, fit_take
from livehand.backend.rendering.renderer import Renderer
from livehand.backend.tracking.tracker import HandTracker
from livehand.backend.tracking.weights import load_networks

HAND = load_default_hand()
VIEWS = ("palm", "back", "side")
TIPS = [4, 8, 12, 16, 20]
JOINT_ABOVE = [0, 0, 1, 2, 3, 0, 4, 5, 6, 0, 7, 8, 9, 0, 10, 11, 12, 0, 13, 14, 15]  # of each node's bone


def tracked_takes(count, seed):
    """Yields (take, what was seen of it): poses of the library and mixes of gestures, in turn, from all sides."""
    rng, networks = np.random.default_rng(seed), load_networks()
    renderer = Renderer(load_avatar(shipped_avatar_path("light")), HAND, "cpu")
    for index in range(count):
        take = made_take(rng, HAND, ("library", "mixes")[index % 2], VIEWS[index // 2 % 3])
        tracker = HandTracker(networks, 1)
        found = [tracker.track(picture) for picture in pictures(take, renderer, rng)]
        frames = np.array([frame for frame, hands in enumerate(found) if hands])
        px, world = (np.stack([getattr(found[frame][0], name) for frame in frames]) for name in ("px", "world"))
        yield take, FilmedHand(frames, px, world)


def learn(takes):
    parts = []
    for take, seen in takes:
        nodes = at_nodes(true_landmarks(take, HAND))[seen.frames]
        frames = np.stack([bone_frames(HAND, take.motion.pose(index))[:, :3, :3] for index in seen.frames])
        places = (seen.px - take.camera.K[:2, 2]) / take.camera.K[0, 0]
        parts.append((nodes, frames[:, JOINT_ABOVE], at_nodes(places), np.ptp(places, axis=1).max(-1)))
    definition = learnt_definition(*(np.concatenate(column) for column in zip(*parts, strict=True)))
    for row in definition.offsets_m * 1000:
        print("        [" + ", ".join(f"{value:.1f}" for value in row) + "],")


def measure(takes):
    rows = []
    for take, seen in takes:
        camera = FilmCamera(take.camera.size_px, take.camera.K[0, 0])
        fit = fit_take(seen, np.arange(len(take.motion)) / 30, camera, HAND, "right", 30.0)
        kept = slice(seen.frames[0], seen.frames[-1] + 1)
        both = axis_angle_to_matrix(fit.motion.theta).swapaxes(-1, -2) @ axis_angle_to_matrix(take.motion.theta[kept])
        off_deg = np.rad2deg(np.linalg.norm(matrix_to_axis_angle(both), axis=-1))
        points = np.stack([landmarks_of(HAND, fit.motion.pose(index)) for index in range(len(fit.motion))])
        true = true_landmarks(take, HAND)[kept]
        tips = ((points - points[:, :1]) - (true - true[:, :1]))[:, TIPS]
        rows.append((off_deg[:, 1:].mean(), off_deg[:, 0].mean(), 1000 * np.linalg.norm(tips, axis=-1).mean()))
        print("fingers {:.1f} deg, wrist {:.1f} deg, tips {:.1f} mm".format(*rows[-1]), flush=True)
    print("mean: fingers {:.2f} deg, wrist {:.2f} deg, tips {:.1f} mm".format(*np.mean(rows, 0)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--takes", type=int, default=12)
    parser.add_argument("--seed", type=int, default=100)
    parser.add_argument("--gates", action="store_true", help="measure instead of learning")
    args = parser.parse_args()
    (measure if args.gates else learn)(tracked_takes(args.takes, args.seed))
