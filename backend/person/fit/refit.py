"""Poses of all pictures and one shape, fitted again: by flow between what the model renders and pictures, and outlines.

Landmarks put a hand within a centimetre, from where flow leads on. Pictures of one moment share their pose, all share
the shape; held-out ones fit their pose alone. What the shape's ten numbers cannot say is told by outlines: a vertex at
one has its normal in the picture's plane, and is seen to be too far in or out. Many pictures, each a little off itself,
see it so; between them, and where none does, the skin moves with its neighbours.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...capture.masks.mask import load_opencv
from ...geometry.mesh_tables import area_weighted_normals
from ...hand.lbs import posed_vertices
from ...records.hand_picture import HandPicture
from ...records.shot import HandPose
from ...rigs.model_transfer.registration import Smoothness, smoothed
from ...system.parallel_map import parallel_map
from ...system.thread_limits import thread_limit
from ..lit_model.model import PersonModel
from ..lit_model.picture_lights import PictureIlluminations
from .pose_fit import fitted_poses
from .pose_targets import PoseTargets, pose_targets

_OFF_MM = 1.5  # of a picture's pose: distances beyond it count less
_SMOOTHNESS = Smoothness(stiffness=30.0, decay=0.5)
_ARM_WEIGHT = 20.0  # by which the forearm, whose sleeve or bend is not known, keeps the model's shape
_STEP_M = 1e-3
_MOST_MM = 4.0


@dataclass(frozen=True)
class Refit:
    """Pictures with their new poses.

    Attributes:
        pictures: as they were given, but for the poses.
        offset_m: [V] of the person's shape, along the normals.
        flow_px, overlap: means over the pictures before the fit.
    """

    pictures: tuple[HandPicture, ...]
    offset_m: np.ndarray
    flow_px: float
    overlap: float


def refitted(
    model: PersonModel,
    pictures: Sequence[HandPicture],
    lights: PictureIlluminations,
    fits_shape: bool = True,
    on_picture: Callable[[], None] = lambda: None,
    length_m: float | None = None,
    longest_px: int | None = None,
    fits_offsets: bool = False,
) -> Refit:
    """Fit the poses of all pictures and one shape once, from where they are.

    Args:
        model: with the person's skin so far.
        pictures: with their poses, whose shape is one.
        lights: of every picture.
        fits_shape: move the shape, too.
        on_picture: called after each one's flow.
        length_m: of the hand (`hand_size.sized`); None: not known.
        longest_px: side of the pictures in which flow is looked for; None: their own.
        fits_offsets: fit what the shape's numbers cannot say, after the poses.
    """

    def targets_in(picture: HandPicture) -> PoseTargets:
        small = made_smaller(picture, longest_px)
        larger_by = np.divide(picture.camera.size_px, small.camera.size_px)
        return pose_targets(model, small, lights.at(picture)).enlarged(larger_by)

    targets = parallel_map(targets_in, pictures, on_picture)
    with thread_limit(1):  # operations are small: threads would only wait for each other
        offsets_m = [_offset(model, picture.pose) for picture in pictures]
        poses = fitted_poses(model.hand, pictures, targets, offsets_m, fits_shape, length_m)
    moved = tuple(replace(picture, pose=pose) for picture, pose in zip(pictures, poses, strict=True))
    offset_m = outline_offsets(model, moved, targets) if fits_offsets else model.offset_m
    flow_px, overlap = (float(np.mean([getattr(each, name) for each in targets])) for name in ("flow_px", "overlap"))
    return Refit(moved, offset_m, flow_px, overlap)


def made_smaller(picture: HandPicture, longest_px: int | None) -> HandPicture:
    """Return a picture whose sides are no longer than this; None: the picture itself."""
    longest_now_px = max(picture.camera.size_px)
    if longest_px is None or longest_px >= longest_now_px:
        return picture
    factor = longest_px / longest_now_px
    cv2, camera = load_opencv(), picture.camera.scaled(factor)
    rgb = cv2.resize(picture.rgb, camera.size_px, interpolation=cv2.INTER_AREA)
    labels = cv2.resize(picture.labels, camera.size_px, interpolation=cv2.INTER_NEAREST)
    return replace(picture, rgb=rgb, labels=labels, camera=camera)


def _offset(model: PersonModel, pose: HandPose) -> np.ndarray:
    """Return what the person's own shape adds to the posed vertices [V, 3], m, world; small turns do not change it."""
    return model.vertices(pose) - posed_vertices(model.hand, pose)


def outline_offsets(model: PersonModel, pictures: Sequence[HandPicture], targets: Sequence[PoseTargets]) -> np.ndarray:
    """Fit the offsets [V], m, along the normals to the outlines of all pictures that are not held out.

    Args:
        model: with the offsets so far, from which `targets` were found.
        pictures: in the poses that were fitted to the targets.
        targets: of each picture.
    """
    weight = _ARM_WEIGHT * np.asarray(model.hand.arm_weights, float)
    pull = np.zeros_like(weight)
    for picture, target in zip(pictures, targets, strict=True):
        if picture.is_held_out:
            continue
        vertex, along, off_mm = _off(model, picture, target)
        trust = 1 / np.sqrt(1 + (off_mm / _OFF_MM) ** 2)
        np.add.at(weight, vertex, trust * along**2)
        np.add.at(pull, vertex, trust * along * (off_mm + along * 1000 * model.offset_m[vertex]))
    wanted_mm = pull / np.maximum(weight, 1e-9)
    return smoothed(model.hand, wanted_mm, weight, _SMOOTHNESS).clip(-_MOST_MM, _MOST_MM) / 1000


def _off(model: PersonModel, picture: HandPicture, target: PoseTargets) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return which vertices lie at the outline, how far a mm of offset moves each across it, and how far it should."""
    outline, camera = target.outline, picture.camera
    vertices = model.vertices(picture.pose)
    moved = vertices + _STEP_M * area_weighted_normals(vertices, model.hand.f)
    (px, depth_m), (moved_px, _) = (camera.project(points[outline.vertex]) for points in (vertices, moved))
    px_per_mm = np.abs(camera.K[0, 0]) / depth_m / 1000
    along = ((moved_px - px) * outline.normal).sum(1) / px_per_mm
    return outline.vertex, along, ((outline.px - px) * outline.normal).sum(1) / px_per_mm
