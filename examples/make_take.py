"""Make `take.json`: a synthetic take of a left hand that counts from one to five, as tracked by MediaPipe.

Run it with the Python that LiveHand is installed in: `python examples/make_take.py [OUT.json]`.

Two seconds of 21 world landmarks, 12 a second: metres, in the camera's axes (x right, y down, z forward), relative to
the hand's centre. The hand is upright with its back to the camera. Its label is "Right", MediaPipe's label of a left
hand in a picture that is not mirrored.
"""

import json
import sys
from pathlib import Path

import numpy as np
from livehand.backend.geometry.rotation import axis_angle_to_matrix
from livehand.backend.hand.model import MIRROR_POINT, UPRIGHT
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.poses import POSES
from livehand.backend.motion.landmarks.skeleton import NODES_OF_LANDMARKS, HandSkeleton

COUNT = 24
FPS = 12
GESTURES = ("Fist", "One", "Two", "Three", "Four", "Five")
HOLD = 0.35  # fraction of the time between two gestures without motion
LEAN_RAD = 0.12  # of the wrist, to and fro
WORLD_TO_CAMERA = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # of a camera that looks along +Y


def take() -> dict:
    """The file's content."""
    return {"handedness": "Right", "fps": FPS, "world_landmarks": landmarks().round(4).tolist()}


def landmarks() -> np.ndarray:
    """[COUNT, 21, 3] m, of a left hand in the camera's axes."""
    skeleton = HandSkeleton.of(load_default_hand())
    lean = LEAN_RAD * np.sin(np.linspace(0, 2 * np.pi, COUNT))
    root = axis_angle_to_matrix(lean[:, None] * [0.0, 1, 0]) @ UPRIGHT
    angles = np.deg2rad(angles_deg()).reshape(COUNT, 5, 3, 3)
    right = skeleton.pose(root, np.zeros((COUNT, 3)), angles, skeleton.offsets(np.zeros(10))).nodes
    seen = (right * MIRROR_POINT)[:, list(NODES_OF_LANDMARKS)] @ WORLD_TO_CAMERA.T
    return seen - seen.mean(1, keepdims=True)


def angles_deg() -> np.ndarray:
    """[COUNT, 15, 3] flexion, abduction and twist of joints 1..15: from gesture to gesture, with pauses."""
    gestures = np.array([POSES[name].gesture.angles_deg() for name in GESTURES])
    place = np.linspace(0, len(GESTURES) - 1, COUNT)
    before = np.minimum(place.astype(int), len(GESTURES) - 2)
    share = np.clip((place - before - HOLD / 2) / (1 - HOLD), 0, 1)
    share = (share**2 * (3 - 2 * share))[:, None, None]
    return (1 - share) * gestures[before] + share * gestures[before + 1]


if __name__ == "__main__":
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("take.json")
    path.write_text(json.dumps(take(), separators=(",", ":")) + "\n")
    print(f"{path}: {path.stat().st_size / 1e3:.0f} kB")
