"""A made rig: two hands of one person in eight made cameras."""

from dataclasses import dataclass

import numpy as np
import pytest
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_arrays
from livehand.backend.hand.model import HandModel
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.poses import POSES
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.person.rig.association import AssociatedHand, Find
from livehand.backend.person.rig.calibration import RigView
from livehand.backend.person.rig.outlines import covered_pixels
from livehand.backend.person.rig.rig_hands import RigHands
from livehand.backend.person.rig.view_masks import mesh_labels
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.shot import HandPose

SIZE_PX = (400, 320)
FOCAL_PX = 520.0
BETA = np.array([0.6, -0.4, 0.3, 0.0, 0.2, 0.0, 0.0, 0.0, 0.0, 0.0])
SKIN, CLOTH, SHADOW = (205, 150, 120), (40, 60, 70), 24


@dataclass(frozen=True)
class MadeRig:
    """Poses of both hands with one shape, and the cameras; what they show is exact."""

    model: HandModel
    poses: dict
    cameras: tuple[Camera, ...]

    @property
    def hands(self) -> RigHands:
        return RigHands.of(self.model, tuple(self.poses))

    @property
    def vertices(self) -> np.ndarray:
        return np.concatenate([posed_arrays(self.model, pose)[0] for pose in self.poses.values()])

    @property
    def points(self) -> np.ndarray:
        """[S, 21, 3] landmarks."""
        return np.stack([landmarks_of(self.model.for_side(side), pose) for side, pose in self.poses.items()])

    def found(self, noise_px=0.0, seed=0) -> list[AssociatedHand]:
        """All hands with their finds in all views."""
        rng, hands = np.random.default_rng(seed), []
        for side, points in zip(self.poses, self.points, strict=True):
            px = [camera.project(points)[0] + rng.normal(0, noise_px, (21, 2)) for camera in self.cameras]
            finds = tuple(Find(row, place, float(side == "right")) for row, place in enumerate(px))
            hands.append(AssociatedHand(side, finds, points + rng.normal(0, noise_px * 1e-4, points.shape)))
        return hands

    def labels(self, vertices=None) -> list[np.ndarray]:
        """The labels of all views by the meshes."""
        vertices, hands = self.vertices if vertices is None else vertices, self.hands
        return [mesh_labels(covered_pixels(vertices, hands.faces, camera), hands) for camera in self.cameras]

    def views(self, vertices=None, seed=0) -> list[RigView]:
        """Skin in noisy colours before noisy cloth."""
        rng, views = np.random.default_rng(seed), []
        for row, (camera, labels) in enumerate(zip(self.cameras, self.labels(vertices), strict=True)):
            rgb = np.where((labels > 0)[..., None], SKIN, CLOTH) + rng.normal(0, 6, (*labels.shape, 3))
            rgb[..., :] -= SHADOW * np.linspace(0, 1, labels.shape[1])[None, :, None]
            views.append(RigView(f"{row:02d}.png", rgb.clip(0, 255).astype(np.uint8), camera, 2 * row))
        return views


@pytest.fixture(scope="session")
def made_rig():
    """Two open hands apart, and cameras around them."""
    model = load_default_hand()
    places = {"right": (0.09, 0.0, 0.01), "left": (-0.09, 0.01, 0.0)}
    poses = {
        side: made_pose(model, side, name, places[side]) for side, name in (("right", "Open"), ("left", "Relaxed"))
    }
    angles = np.deg2rad(np.arange(8) * 45.0 + 10)
    heights = np.array([0.25, 0.05, -0.2, 0.3, 0.0, 0.28, -0.25, 0.1])
    places = [0.62 * np.array([np.cos(a), np.sin(a), h]) for a, h in zip(angles, heights, strict=True)]
    K = np.array([[FOCAL_PX, 0, SIZE_PX[0] / 2], [0, FOCAL_PX, SIZE_PX[1] / 2], [0, 0, 1.0]])
    return MadeRig(
        model, poses, tuple(Camera(K, look_at(at, np.zeros(3), np.array([0, 0, 1.0])), SIZE_PX) for at in places)
    )


def made_pose(model, side, name, place) -> HandPose:
    """A gesture with its middle at a place."""
    theta = theta_of(POSES[name].gesture.angles_deg(), FingerAxes.of_default_hand()).copy()
    turn = axis_angle_to_matrix(np.array([0.3, 0.2, -1.5])) @ axis_angle_to_matrix(theta[0])
    theta[0] = matrix_to_axis_angle(turn)
    pose = HandPose(theta, BETA, np.zeros(3), "right", np.array([0.05, -0.05, 0.1]))
    pose = pose if side == "right" else pose.mirrored()
    middle = landmarks_of(model.for_side(side), pose).mean(0)
    return HandPose(pose.theta, BETA, np.array(place) - middle, side, pose.forearm)
