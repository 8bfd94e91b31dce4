"""*Grasp* in a scene: one frame or a range, one hand on things or two hands on each other.

Flattened pads are shape keys of the hand's mesh: a few, whose values follow over a shot. What they move is pale in
frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import bpy
import numpy as np

from ...backend.contact.grasp import Grasp, Grasper, GraspOptions
from ...backend.contact.grasped_shot import grasped_shot
from ...backend.contact.pads import flat_pads
from ...backend.contact.placed_solids import PlacedSolid
from ...backend.hand.model import HandModel
from ...backend.records.errors import LiveHandError
from ...backend.records.shot import HandPose
from ...backend.system.child_job import JobProgress, Report
from ..motion.frames import current_frame_restored
from ..rig.hand import RiggedHand
from ..rig.keyframes import key_values, keyframe_theta
from ..rig.pads import PADS_PREFIX, clear_pads
from ..rig.pose import read_pose, write_theta, write_transl
from .targets import Targets

_CLASPS = 2  # times that each of two hands closes on the other
_MOST_KEYS = 6
_LEFT_OUT_M = 0.00005  # of the offsets, that the keys may miss


def grasp_now(
    context: bpy.types.Context, hand: RiggedHand, targets: Targets, options: GraspOptions, flattens: bool
) -> Grasp:
    """Close a hand on things in the current frame; its sliders and IK go to zero.

    Raises:
        LiveHandError: as `Grasper.grasp`; nothing is changed then.
    """
    depsgraph = context.evaluated_depsgraph_get()
    given, things = read_pose(hand, depsgraph), targets.placed(hand, depsgraph)
    found = Grasper(hand.model, given.beta).grasp(given, things, options)
    _check_editable(hand)
    write_theta(hand, found.pose.theta, found.pose.forearm)
    write_transl(hand, found.pose.transl)
    if flattens:
        set_pads(hand.mesh, flat_pads(hand.model, found.pose, things).rest_offsets[None])
    else:
        clear_pads(hand.mesh)
    return found


def clasp_now(
    context: bpy.types.Context, hands: tuple[RiggedHand, RiggedHand], options: GraspOptions, flattens: bool
) -> list[Grasp]:
    """Close two hands on each other in the current frame, in turn. Raises as `grasp_now`."""
    found: list[Grasp] = []
    for _ in range(_CLASPS):
        found = []
        for hand, other in (hands, hands[::-1]):
            clear_pads(other.mesh)
            context.view_layer.update()
            found.append(grasp_now(context, hand, Targets([other.mesh]), options, flattens))
    return found


class ShotToGrasp(NamedTuple):
    """A hand's poses in T frames, and the things in its own space in each of them."""

    poses: list[HandPose]
    things: list[list[PlacedSolid]]


class GraspedFrames(NamedTuple):
    """The grasps of T frames, and how their unposed skin is flattened, [T, V, 3] m; None: it is not."""

    grasps: list[Grasp]
    rest_offsets: np.ndarray | None


class GraspStopped(Exception):
    """The caller's `should_stop` returned True."""


def read_frames(context: bpy.types.Context, hand: RiggedHand, targets: Targets, frames: Sequence[int]) -> ShotToGrasp:
    """Read a hand's poses and the things around it in frames of the scene.

    Raises:
        LiveHandError: the hand is linked, its shape changes, or a thing has no faces.
    """
    _check_editable(hand)
    poses, things = [], []
    with current_frame_restored(context.scene):
        for frame in frames:
            context.scene.frame_set(frame)
            depsgraph = context.evaluated_depsgraph_get()
            poses.append(read_pose(hand, depsgraph))
            things.append(targets.placed(hand, depsgraph))
    if any(not np.array_equal(pose.beta, poses[0].beta) for pose in poses):
        raise LiveHandError(f"{hand.armature.name} must keep its shape over the frames; remove the shape's keys")
    return ShotToGrasp(poses, things)


def grasped_frames(
    model: HandModel,
    shot: ShotToGrasp,
    options: GraspOptions,
    flattens: bool,
    report: Report = lambda progress: None,
    should_stop: Callable[[], bool] = lambda: False,
) -> GraspedFrames:
    """Close a hand on things over a shot; Blender's data is not touched.

    Raises:
        LiveHandError: as `grasped_shot`.
        GraspStopped: `should_stop` returned True.
    """

    def tell(share: float) -> None:
        if should_stop():
            raise GraspStopped
        report(JobProgress(f"{len(shot.poses)} frames", share))

    tell(0.0)
    found = grasped_shot(Grasper(model, shot.poses[0].beta), shot.poses, shot.things, options, tell)
    if not flattens:
        return GraspedFrames(found, None)
    pads = [flat_pads(model, one.pose, row) for one, row in zip(found, shot.things, strict=True)]
    return GraspedFrames(found, np.stack([one.rest_offsets for one in pads]))


def key_grasps(hand: RiggedHand, found: GraspedFrames, frames: Sequence[int]) -> None:
    """Key a hand's fingers and flattened pads in frames. Raises LiveHandError if it is linked."""
    _check_editable(hand)
    keyframe_theta(hand, np.stack([one.pose.theta for one in found.grasps]), frames, range(1, 16))
    clear_pads(hand.mesh)
    if found.rest_offsets is not None:
        set_pads(hand.mesh, found.rest_offsets, frames)


def _check_editable(hand: RiggedHand) -> None:
    for owner in (hand.armature, hand.mesh, hand.mesh.data):
        if owner.library is not None:
            raise LiveHandError(
                f"{owner.name} must be local to this file to grasp, it is linked; choose Object > Library Override > "
                "Make, or append it"
            )


def set_pads(mesh: bpy.types.Object, rest_offsets: np.ndarray, frames: Sequence[int] = ()) -> None:
    """Give a hand's mesh shape keys by which its pads flatten; those of an earlier grasp go.

    Args:
        mesh: of the hand.
        rest_offsets: [T, V, 3] m, of the unposed skin.
        frames: [T] of the scene, in which the keys' values are keyed; none: T is 1, and its key stays on.
    """
    clear_pads(mesh)
    flat = rest_offsets.reshape(len(rest_offsets), -1)
    if not np.abs(flat).max(initial=0.0) > _LEFT_OUT_M:
        return
    values, shapes = _components(flat)
    rest = np.empty(flat.shape[1], np.float32)
    mesh.data.shape_keys.reference_key.data.foreach_get("co", rest)
    for number, (value, shape) in enumerate(zip(values.T, shapes, strict=True)):
        key = mesh.shape_key_add(name=f"{PADS_PREFIX} {number + 1}", from_mix=False)
        key.data.foreach_set("co", rest + shape.astype(np.float32))
        key.slider_min, key.slider_max, key.value = -1.0, 1.0, float(value[0])
        if len(frames):
            path = f'key_blocks["{key.name}"].value'
            key_values(mesh.data.shape_keys, path, PADS_PREFIX, np.asarray(frames, float), value)


def _components(flat: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split offsets [T, n] into values [T, K], at most 1, and shapes [K, n]."""
    left, sizes, right = np.linalg.svd(flat, full_matrices=False)
    count = 1
    while count < min(_MOST_KEYS, len(sizes)):
        missed = flat - (left[:, :count] * sizes[:count]) @ right[:count]
        if np.abs(missed).max() <= _LEFT_OUT_M:
            break
        count += 1
    values, shapes = left[:, :count] * sizes[:count], right[:count]
    largest = np.abs(values).max(0)
    return values / largest, shapes * largest[:, None]
