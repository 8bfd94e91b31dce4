"""The plan of a synthetic capture: poses, cameras and splits, all drawn from one seed.

World: Blender's, Z up, metres; the front of the light is -Y.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Literal, NamedTuple, get_args

import numpy as np

from ..geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from ..hand.bones import rest_flexion_deg
from ..hand.gestures import theta_of
from ..hand.joint_axes import finger_axes
from ..hand.model import UPRIGHT, HandModel
from ..hand.model_file import load_default_hand
from ..hand.poses import sample_poses_deg
from ..records.camera import Camera, look_at
from ..records.shot import HandPose
from .capture import Capture, CaptureView, Split
from .lights import CaptureLight
from .person import PERSONS, Person
from .split import split_of
from .varied_light import HELD_OUT_KINDS, LightDrawing, light_groups

DISTANCE_M = 0.75
# Lengths for the built-in hand; they scale with the size of another hand.
WHOLE_HAND_M = 0.25  # height of the field of view at the hand: holds the whole hand in any pose
CLOSE_UP_M = (0.08, 0.15)
CLOSE_UP_JITTER_M = 0.03
# Of a hand with a forearm: height of the field of view, and how far its middle lies below the middle knuckle.
NEAR_ARM_M, WHOLE_ARM_M, WRIST_CLOSE_UP_M = (0.31, 0.03), (0.43, 0.085), (0.15, 0.1)
TILT_DEG = 25.0
YAW_DEG = 55.0
# Of the wrist: flexion to the palm, deviation to the little finger, twist of the forearm.
WRIST_LIMITS_DEG = np.array([(-60.0, 60.0), (-20.0, 30.0), (-30.0, 30.0)])
NEARLY_STRAIGHT_DEG = 6.0
_KNUCKLES = (1, 4, 7, 10)
_ARM_SEED = 1


@dataclass(frozen=True)
class CapturePlan:
    """The size of a capture. Equal plans give the same poses, cameras and light.

    Attributes:
        seed: of every random choice.
        poses: number of poses; every 11th, from the 6th, is held out.
        cameras: number of cameras; every 5th, from the 4th, is held out; every 2nd is a close-up, of 0.15 to 0.3 mm a
            pixel at the usual size; if the hand has a forearm, they show it too.
        cameras_per_pose: number of training cameras that see each pose, drawn anew for each.
        person: whose hand it is; a hand model of one's own keeps its own shape and look.
        size_px: (width, height) of an image.
        samples: Cycles samples per pixel of training views.
        eval_samples: Cycles samples per pixel of held-out views, enough that noise does not hide progress.
        eval_views: largest number of views in each held-out split; with varied lights, the split `test` has half as
            many of each of its five kinds of light.
        first_poses: render only this many of the poses (None: all); the rest of the plan can be rendered later.
        lights: the dome for all images, or for each image a light of its own (`varied_light`).
    """

    seed: int = 0
    poses: int = 99
    cameras: int = 25
    cameras_per_pose: int = 6
    person: Person = PERSONS["light"]
    size_px: tuple[int, int] = (334, 512)
    samples: int = 8
    eval_samples: int = 64
    eval_views: int = 12
    first_poses: int | None = None
    lights: Literal["dome", "varied"] = "dome"

    def make(self, folder: Path, model: HandModel, provenance: dict) -> Capture:
        """Plan the capture's index."""
        rng = np.random.default_rng(self.seed)
        forearms = np.zeros((self.poses, 3))
        if model.has_arm:
            forearms = sample_forearms(np.random.default_rng((self.seed, _ARM_SEED)), self.poses)
        poses = _sample_poses(rng, forearms, model, np.array(self.person.beta))
        size = _relative_size(model)
        views = _spread_views(self, _sample_cameras(rng, self, size, model.has_arm))
        lit = LitViews(views, ()) if self.lights == "dome" else light_views(views, self.seed, size, model, poses)
        if self.first_poses is not None:
            lit = of_first_poses(lit, self.first_poses)
        return Capture(folder, model.sha256, provenance, poses, lit.views, lit.lights)

    def facts(self) -> dict:
        """Describe the plan for a capture's provenance; that of a capture in the dome names no lights."""
        return {name: value for name, value in asdict(self).items() if (name, value) != ("lights", "dome")}

    def is_held_out_pose(self, index: int) -> bool:
        """Tell whether no training view shows this pose."""
        return index % 11 == 5

    def is_held_out_camera(self, index: int) -> bool:
        """Tell whether no training view comes from this camera."""
        return index % 5 == 3

    def is_close_up(self, index: int) -> bool:
        """Tell whether this camera shows a part of the hand."""
        return index % 2 == 1


def _sample_poses(
    rng: np.random.Generator, forearms: np.ndarray, model: HandModel, beta: np.ndarray
) -> tuple[HandPose, ...]:
    """Draw poses with these turns [P, 3] of a right hand's forearm; the middle knuckle lies near the world's origin."""
    from ..hand.penetration import HandParts, relieved_angles  # needs torch, which the command's help does not

    right = model.for_side("right")
    axes, offset = finger_axes(right), _rest_deg(load_default_hand()) - _rest_deg(right)
    parts, poses = HandParts(right), []
    for angles, forearm in zip(sample_poses_deg(rng, len(forearms)), forearms, strict=True):
        angles[:, :2] += offset  # gestures are relative to the built-in hand's rest pose
        angles = relieved_angles(parts, right, angles, axes)
        root = axis_angle_to_matrix(np.array([0, 0, np.deg2rad(rng.normal(0, YAW_DEG))])) @ _random_tilt(rng) @ UPRIGHT
        middle = right.joints[0] + root @ (right.joints[4] - right.joints[0])
        transl = -middle + rng.normal(0, 0.006, 3)
        poses.append(HandPose(theta_of(angles, axes, matrix_to_axis_angle(root)), beta, transl, "right", forearm))
    return tuple(poses if model.side == "right" else (pose.mirrored() for pose in poses))


def sample_forearms(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw [count, 3] `HandPose.forearm` of right hands within `WRIST_LIMITS_DEG`; every other one nearly straight."""
    turns = []
    for index in range(count):
        drawn = rng.normal(0, NEARLY_STRAIGHT_DEG, 3) if index % 2 else rng.uniform(*WRIST_LIMITS_DEG.T)
        flexion, deviation, twist = np.deg2rad(np.clip(drawn, *WRIST_LIMITS_DEG.T))
        # The template's fingers point to -X, its back to +Y: flexion takes the arm's end to -Y, deviation to -Z.
        bend = axis_angle_to_matrix(np.array([0, deviation, 0])) @ axis_angle_to_matrix(np.array([0, 0, -flexion]))
        turns.append(matrix_to_axis_angle(bend @ axis_angle_to_matrix(np.array([twist, 0, 0]))))
    return np.array(turns).reshape(count, 3)


def _rest_deg(right: HandModel) -> np.ndarray:
    """Return [15, 2] flexion and abduction of a right hand's fingers at rest; the thumb's abduction is taken as 0."""
    abduction = np.zeros(15)
    for first in _KNUCKLES:
        along = right.joints[first + 1] - right.joints[first]
        abduction[first - 1] = np.rad2deg(np.arctan2(along[2], -along[0]))  # fingers point to -X; the thumb is at +Z
    return np.stack([rest_flexion_deg(right), abduction], -1)


def _relative_size(model: HandModel) -> float:
    """Return the hand's reach from its middle knuckle short of the wrist, relative to the built-in hand's."""
    return _reach(model) / _reach(load_default_hand())


def _reach(hand: HandModel) -> float:
    right = hand.for_side("right")
    hand_alone = right.v_template[right.v_template[:, 0] < right.joints[0, 0]]
    return float(np.linalg.norm(hand_alone - right.joints[4], axis=1).max())


def _random_tilt(rng: np.random.Generator) -> np.ndarray:
    return axis_angle_to_matrix(np.deg2rad(rng.normal(0, TILT_DEG, 3)))


def _sample_cameras(rng: np.random.Generator, plan: CapturePlan, size: float, has_arm: bool) -> list[Camera]:
    """Draw cameras all around a hand of this relative size; every second one is a close-up.

    With a forearm, every third close-up is of the wrist, and the others show the near half of the arm, or all of it.
    """
    width, height = plan.size_px
    cameras = []
    for index, direction in enumerate(_camera_directions(rng, plan)):
        field_of_view_m, below_m, target = WHOLE_HAND_M, 0.0, np.zeros(3)
        if plan.is_close_up(index):
            field_of_view_m, target = rng.uniform(*CLOSE_UP_M), rng.normal(0, CLOSE_UP_JITTER_M, 3)
            if has_arm and index % 6 == 5:
                field_of_view_m, below_m = WRIST_CLOSE_UP_M
        elif has_arm:
            field_of_view_m, below_m = WHOLE_ARM_M if index % 10 == 4 else NEAR_ARM_M
        target = size * (target - np.array([0, 0, below_m]))
        focal_px = max(plan.size_px) * DISTANCE_M / (size * field_of_view_m)
        K = np.array([[focal_px, 0, width / 2], [0, focal_px, height / 2], [0, 0, 1.0]])
        up = np.array([0, 0, 1.0]) if abs(direction[2]) < 0.9 else np.array([0, 1.0, 0])
        cameras.append(Camera(K, look_at(target + DISTANCE_M * direction, target, up), plan.size_px))
    return cameras


def _camera_directions(rng: np.random.Generator, plan: CapturePlan) -> np.ndarray:
    """Compute [cameras, 3] unit vectors.

    Training cameras lie on a Fibonacci sphere in a random orientation, each held-out one halfway between one of them
    and its nearest neighbour.
    """
    held_out = np.array([plan.is_held_out_camera(index) for index in range(plan.cameras)])
    training = fibonacci_sphere(int((~held_out).sum())) @ axis_angle_to_matrix(rng.normal(0, 1, 3)).T
    chosen = rng.permutation(len(training))[: held_out.sum()]
    nearest = np.argsort(-training @ training.T, 1)[:, 1 % len(training)]
    between = training[chosen] + training[nearest[chosen]]
    directions = np.empty((plan.cameras, 3))
    directions[~held_out] = training
    directions[held_out] = between / np.linalg.norm(between, axis=1, keepdims=True)
    return directions


def fibonacci_sphere(count: int) -> np.ndarray:
    """Spread unit vectors [count, 3] evenly over the sphere."""
    z = 1 - 2 * (np.arange(count) + 0.5) / count
    longitude = np.arange(count) * np.pi * (3 - np.sqrt(5))
    radius = np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(longitude), radius * np.sin(longitude), z], -1)


def _spread_views(plan: CapturePlan, cameras: list[Camera]) -> tuple[CaptureView, ...]:
    """Spread every training pose over some training cameras, and the views of each held-out split evenly."""
    by_split: dict[Split, list[CaptureView]] = {"train": [], "novel_pose": [], "novel_camera": [], "test": []}
    for pose in range(plan.poses):
        visible_to = _cameras_of_pose(plan, pose)
        for index, camera in enumerate(cameras):
            split = split_of(plan.is_held_out_pose(pose), plan.is_held_out_camera(index))
            if split != "train" or index in visible_to:
                view = CaptureView(f"images/pose{pose:03d}_cam{index:02d}.png", camera, index, pose, split)
                by_split[split].append(view)
    held_out = [_spread(by_split[split], _most_views(plan, split)) for split in ("novel_pose", "novel_camera", "test")]
    chosen = sum(held_out, by_split["train"])
    if plan.lights == "varied":
        chosen += [_in_novel_light(view) for view in _spread(by_split["train"], plan.eval_views)]
    return tuple(sorted(chosen, key=lambda view: view.file))


def _most_views(plan: CapturePlan, split: Split) -> int:
    is_by_kind = plan.lights == "varied" and split == "test"
    return max(1, plan.eval_views // 2) * len(HELD_OUT_KINDS) if is_by_kind else plan.eval_views


def _in_novel_light(view: CaptureView) -> CaptureView:
    return replace(view, file=view.file.replace(".png", "_novel.png"), split="novel_light")


def _cameras_of_pose(plan: CapturePlan, pose: int) -> set[int]:
    """Draw the training cameras that see a training pose, with the seed (plan.seed, pose)."""
    training = [index for index in range(plan.cameras) if not plan.is_held_out_camera(index)]
    return set(np.random.default_rng((plan.seed, pose)).permutation(training)[: plan.cameras_per_pose].tolist())


def _spread(views: list[CaptureView], count: int) -> list[CaptureView]:
    """Select at most `count` of the views, evenly spaced."""
    if len(views) <= count:
        return views
    return [views[k] for k in np.linspace(0, len(views) - 1, count).round().astype(int)]


_OCCLUDER_STEP, _FIRST_OCCLUDED = 8, 3
"""Every eighth training image has a slab or a wall."""


class LitViews(NamedTuple):
    """Views, and the lights that they refer to."""

    views: tuple[CaptureView, ...]
    lights: tuple[CaptureLight, ...]


def light_views(
    views: Sequence[CaptureView], seed: int, hand_size: float, model: HandModel, poses: Sequence[HandPose]
) -> LitViews:
    """Give each view a light: a training view becomes one of each light group, a held-out view stays one.

    Args:
        views: of the capture; a `novel_light` view may show what a training view shows.
        seed: of the lights.
        hand_size: relative to the built-in hand's.
        model: of the hand.
        poses: that the views show.
    """
    from ..hand.lbs import posed_vertices  # needs torch, which the command's help does not

    lit, lights = [], []
    training = 0
    skins_m = [posed_vertices(model, pose) for pose in poses]
    kinds = {split: iter(_held_out_kinds(views, split, seed)) for split in get_args(Split) if split != "train"}
    for view in views:
        drawing = LightDrawing(_generator(view, seed), _towards(view), hand_size, skins_m[view.pose_index])
        if view.split == "train":
            groups = light_groups(drawing.training_light(training % _OCCLUDER_STEP == _FIRST_OCCLUDED))
            training += 1
        else:
            groups = (drawing.light(next(kinds[view.split])),)
        for index, light in enumerate(groups):
            lit.append(replace(view, file=_group_file(view.file, index), light=len(lights)))
            lights.append(light)
    return LitViews(tuple(lit), tuple(lights))


def of_first_poses(lit: LitViews, count: int) -> LitViews:
    """Select the views of the first poses, and their lights."""
    kept = [view for view in lit.views if view.pose_index < count]
    used = sorted({view.light for view in kept if view.light is not None})
    place = {light: index for index, light in enumerate(used)}
    views = tuple(replace(view, light=None if view.light is None else place[view.light]) for view in kept)
    return LitViews(views, tuple(lit.lights[index] for index in used))


def _held_out_kinds(views: Sequence[CaptureView], split: Split, seed: int) -> list:
    """Draw a kind of light for each view of a held-out split, in equal parts; the dome is not novel."""
    kinds = HELD_OUT_KINDS if split != "novel_light" else HELD_OUT_KINDS[:-1]
    count = sum(view.split == split for view in views)
    repeated = [kinds[index % len(kinds)] for index in range(count)]
    order = np.random.default_rng((seed, get_args(Split).index(split))).permutation(count)
    return [repeated[index] for index in order]


def _generator(view: CaptureView, seed: int) -> np.random.Generator:
    return np.random.default_rng((seed, view.pose_index, view.camera_index, get_args(Split).index(view.split)))


def _towards(view: CaptureView) -> np.ndarray:
    """Return [3] unit direction from the hand to the camera, which looks at it."""
    return -view.camera.cam2world[:3, 2]


def _group_file(file: str, group: int) -> str:
    return f"{file.removesuffix('.png')}_g{group}.exr"
