"""*Grasp* in a scene: one frame or a range, one hand on things or two hands on each other.

Flattened pads are shape keys of the hand's mesh: a few, whose values follow over a shot. What they move is pale in
frames.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import bpy
import numpy as np

from ...backend.contact.grasp import Grasp, Grasper, GraspOptions
from ...backend.contact.grasped_shot import grasped_shot
from ...backend.contact.pads import flat_pads
from ...backend.contact.placed_solids import PlacedSolid
from ...backend.records.errors import LiveHandError
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


def grasp_frames(
    context: bpy.types.Context,
    hand: RiggedHand,
    targets: Targets,
    frames: Sequence[int],
    options: GraspOptions,
    flattens: bool,
    report: Callable[[int], None] = lambda done: None,
) -> list[Grasp]:
    """Close a hand on things in frames of the scene, and key its fingers there.

    Raises:
        LiveHandError: as `grasped_shot`, or the hand's shape changes; nothing is changed then.
    """
    poses, things = _sampled(context, hand, targets, frames)
    if any(not np.array_equal(pose.beta, poses[0].beta) for pose in poses):
        raise LiveHandError(f"{hand.armature.name} must keep its shape over the frames; remove the shape's keys")
    found = grasped_shot(Grasper(hand.model, poses[0].beta), poses, things, options, report)
    _check_editable(hand)
    keyframe_theta(hand, np.stack([one.pose.theta for one in found]), frames, range(1, 16))
    clear_pads(hand.mesh)
    if flattens:
        pads = [flat_pads(hand.model, one.pose, row) for one, row in zip(found, things, strict=True)]
        set_pads(hand.mesh, np.stack([one.rest_offsets for one in pads]), frames)
    return found


def _sampled(
    context: bpy.types.Context, hand: RiggedHand, targets: Targets, frames: Sequence[int]
) -> tuple[list, list[list[PlacedSolid]]]:
    """Read a hand's poses and the things around it in frames of the scene."""
    poses, things = [], []
    with current_frame_restored(context.scene):
        for frame in frames:
            context.scene.frame_set(frame)
            depsgraph = context.evaluated_depsgraph_get()
            poses.append(read_pose(hand, depsgraph))
            things.append(targets.placed(hand, depsgraph))
    return poses, things


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
