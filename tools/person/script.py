"""What a film of a stranger shows, and the scenes that are kept from it: poses, cameras and lights. Blender's world.

The hand is about the origin with its fingers up, and the camera looks along +Y.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import PchipInterpolator

from ...backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ...backend.hand.gestures import FingerAxes, sample_angles_deg, theta_of
from ...backend.hand.model import HandModel
from ...backend.hand.poses import POSES
from ...backend.motion.motion import HandMotion
from ...backend.motion.spaces import TO_BLENDER, rest_wrists
from ...backend.records.camera import Camera, look_at
from ...backend.records.light import Lamp, Light, Sky, rotation_facing
from ...backend.records.shot import HandPose

FPS, SECONDS = 6.0, 12.0
FRAMES = round(FPS * SECONDS)
BACK_FRAMES = round(5 * FPS)
"""At the film's start, in which the palm is not seen."""
FILM_SIZE_PX, FILM_FOCAL_PX = (1280, 720), 1000.0
SCENE_SIZE_PX, SCENE_FOCAL_PX = (400, 512), 900.0
_DISTANCE_M, _SWAY_M, _AIM_SWAY_M = 0.45, 0.015, 0.008
_UP = np.array([0.0, 0, 1])
_UPRIGHT = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # in a camera's axes: fingers up, palm towards it
_PALM_M = 0.09  # from the wrist to what is about the origin
# Where the hand is turned at each second: 180 shows its back to the camera, 0 its palm.
_YAW_S, _YAW_DEG = (0, 1.6, 3.7, 5, 9, 10.5, 12), (180, 130, 235, 205, 0, 45, -60)
_KEY_EVERY_S, _OPENNESS, _WRIST_DEG = 3.0, 0.6, 8.0
# Of each kept scene: the pose's name, where it is turned and how it leans, degrees, and where the camera is, m.
_SCENES = (
    ("Five", -90, 12, (0.05, -0.42, 0.08)),
    ("Fist", 90, -12, (-0.08, -0.42, 0.03)),
    ("OK", 20, 12, (0.12, -0.4, -0.04)),
    ("Point", -150, -12, (0.05, -0.42, 0.12)),
    ("Relaxed", -60, 12, (-0.12, -0.41, 0.05)),
    ("Open", 150, -12, (0.05, -0.44, 0.0)),
)


@dataclass(frozen=True)
class Scene:
    """A pose, its view and its light."""

    name: str
    pose: HandPose
    camera: Camera
    light: Light


def film_light() -> Light:
    """Return the film's: one lamp that is no further than a window, and a sky."""
    return Light((_lamp((0.7, -0.4, 0.7), 8.0, 0.25, (1, 0.95, 0.88)),), _sky(0.18, (0.95, 0.98, 1.05), 2.0))


def kept_lights() -> tuple[Light, ...]:
    """Return those of the kept scenes: a small warm lamp, a large one from behind, and a sky alone."""
    return (
        Light((_lamp((0.8, -0.5, 0.3), 9.0, 0.1, (1, 0.9, 0.75)),), _sky(0.1, (0.8, 0.9, 1.1)), shadow_quality="fine"),
        Light((_lamp((-0.2, 0.8, 0.6), 14.0, 0.2),), _sky(0.16), shadow_quality="fine"),
        Light((), _sky(0.25, top=4.0), shadow_quality="fine"),
    )


def film_motion(model: HandModel, beta: np.ndarray, seed: int) -> HandMotion:
    """Move the hand: its back for 5 s, then around to the palm and on; the fingers bend, the wrist a little."""
    rng, axes, t = np.random.default_rng(seed), FingerAxes.of_default_hand(), film_times()
    keys = sample_angles_deg(rng, int(SECONDS / _KEY_EVERY_S) + 2)
    keys = _OPENNESS * POSES["Five"].gesture.angles_deg() + (1 - _OPENNESS) * keys
    key, share = (t / _KEY_EVERY_S).astype(int), ((t / _KEY_EVERY_S) % 1)[:, None, None]
    share = share * share * (3 - 2 * share)
    theta = np.stack([theta_of(each, axes) for each in (1 - share) * keys[key] + share * keys[key + 1]])
    lean_deg, roll_deg = 22 * np.sin(2 * np.pi * t / 4.3), 12 * np.sin(2 * np.pi * t / 6.1 + 1)
    root = _root(yaw_deg(t), lean_deg, roll_deg)
    theta[:, 0] = matrix_to_axis_angle(root)
    forearm = np.deg2rad(_WRIST_DEG) * np.stack([0 * t, np.sin(2 * np.pi * t / 5.7), np.cos(2 * np.pi * t / 4.9)], 1)
    sway_m = _SWAY_M * _wandering(t, (5.2, 3.7, 7.0), 0.0)
    return HandMotion(theta, beta, _placed(model, beta, root, sway_m), FPS, "right", forearm)


def film_cameras() -> list[Camera]:
    """Return the camera of each frame: a phone that a hand holds."""
    t = film_times()
    origin = np.array([0, -_DISTANCE_M, 0.0]) + _SWAY_M * _wandering(t, (4.1, 6.3, 3.1), 0.7)
    aim = np.array([0, 0, -0.015]) + _AIM_SWAY_M * _wandering(t, (2.9, 5.0, 4.4), 1.9)
    up = _UP + 0.02 * _wandering(t, (3.4, 8.0, 6.0), 0.3)
    return [
        _camera(FILM_FOCAL_PX, FILM_SIZE_PX, look_at(*placement)) for placement in zip(origin, aim, up, strict=True)
    ]


def kept_scenes(model: HandModel, beta: np.ndarray) -> list[Scene]:
    """Return scenes of other poses, views and lights than the film's."""
    axes, lights = FingerAxes.of_default_hand(), kept_lights()
    scenes = []
    for index, (name, yaw, lean, origin) in enumerate(_SCENES):
        root = _root(np.array([float(yaw)]), np.array([float(lean)]), np.zeros(1))
        theta = theta_of(POSES[name].gesture.angles_deg(), axes, matrix_to_axis_angle(root)[0])
        pose = HandPose(theta, beta, _placed(model, beta, root, np.array([[0, 0, 0.01]]))[0])
        camera = _camera(SCENE_FOCAL_PX, SCENE_SIZE_PX, look_at(np.array(origin), np.zeros(3), _UP))
        scenes.append(Scene(name, pose, camera, lights[index % len(lights)]))
    return scenes


def film_times() -> np.ndarray:
    """Return [T] s of the frames."""
    return np.arange(FRAMES) / FPS


def yaw_deg(t: np.ndarray) -> np.ndarray:
    """Return where the hand is turned at times [T] s."""
    return PchipInterpolator(_YAW_S, _YAW_DEG)(t)


def _root(yaw_deg: np.ndarray, lean_deg: np.ndarray, roll_deg: np.ndarray) -> np.ndarray:
    """Turn an upright hand [T, 3, 3] about its length, then towards the camera, then in the picture."""
    x, y, z = (
        axis_angle_to_matrix(np.deg2rad(turn)[:, None] * np.eye(3)[axis])
        for axis, turn in enumerate((lean_deg, yaw_deg, roll_deg))
    )
    return TO_BLENDER["opencv"] @ z @ x @ y @ _UPRIGHT


def _placed(model: HandModel, beta: np.ndarray, root: np.ndarray, palm_m: np.ndarray) -> np.ndarray:
    """Return transl [T, 3] that brings the palm to these places [T, 3]; the template's fingers point to -X."""
    return palm_m - _PALM_M * (root @ [-1.0, 0, 0]) - rest_wrists(model, beta)


def _wandering(t: np.ndarray, periods_s: tuple[float, float, float], phase: float) -> np.ndarray:
    return np.stack([np.sin(2 * np.pi * t / period + phase * axis) for axis, period in enumerate(periods_s)], 1)


def _camera(focal_px: float, size_px: tuple[int, int], cam2world: np.ndarray) -> Camera:
    K = np.array([[focal_px, 0, size_px[0] / 2], [0, focal_px, size_px[1] / 2], [0, 0, 1]])
    return Camera(K, cam2world, size_px)


def _lamp(towards: tuple, power_w: float, side_m: float, rgb: tuple = (1.0, 1.0, 1.0)) -> Lamp:
    direction = np.array(towards, float) / np.linalg.norm(towards)
    return Lamp("area", power_w * np.array(rgb), 0.9 * direction, rotation_facing(direction), size_m=(side_m, side_m))


def _sky(level: float, rgb: tuple = (1.0, 1.0, 1.0), top: float = 1.0) -> Sky:
    rows = np.linspace(top, 1, 8)[:, None, None]
    return Sky(np.full((8, 16, 3), level) * np.array(rgb) * rows)
