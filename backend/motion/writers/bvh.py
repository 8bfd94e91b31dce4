"""Motions as BVH: bones named as HumanIK's, in a T-pose at rest, Y up, centimetres.

Two hands have a common root that does not move, as a file has one root. Positions of other joints than the root are
positions below their parent, as the format has them.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from ...system.files import replacing
from .skeleton import SkeletonMotion, skeleton_motion
from .take import Take
from .writer import WriteOptions, Writer

_CM = 100.0
_ROOT = "Hands"
_POSITIONS = "Xposition Yposition Zposition"
_ROTATIONS = "Zrotation Xrotation Yrotation"
_LOCKED = 1e-9  # cosine of the middle angle, below which the other two turn about one axis


def _write(take: Take, path: Path, options: WriteOptions) -> tuple[str, ...]:
    motion = skeleton_motion(take)
    lines = ["HIERARCHY", *_hierarchy(motion), "MOTION", f"Frames: {take.count}", f"Frame Time: {1 / take.fps:.15g}"]
    rows = [" ".join(f"{value:.8f}" for value in row) for row in _channels(motion)]
    with replacing(path) as temporary:
        temporary.write_text("\n".join([*lines, *rows, ""]), encoding="ascii")
    is_shape_moving = any(hand.motion.beta.ndim > 1 for hand in take.hands)
    return ("the shape changes during the take; bones have its mean",) if is_shape_moving else ()


def _hierarchy(motion: SkeletonMotion) -> Iterator[str]:
    roots = [bone for bone, parent in enumerate(motion.parents) if parent < 0]
    if len(roots) == 1:
        yield from _joint(motion, roots[0], "ROOT", 0)
        return
    yield f"ROOT {_ROOT}"
    yield from ("{", "\tOFFSET 0 0 0", f"\tCHANNELS 6 {_POSITIONS} {_ROTATIONS}")
    for root in roots:
        yield from _joint(motion, root, "JOINT", 1)
    yield "}"


def _joint(motion: SkeletonMotion, bone: int, kind: str, depth: int) -> Iterator[str]:
    """Write a joint and those below it, a line at a time."""
    indent, parent = "\t" * depth, motion.parents[bone]
    # A ROOT's OFFSET is where it rests in this file; its channels give its whole place.
    offset = motion.heads[bone] - (motion.heads[parent] if parent >= 0 else 0)
    channels = f"6 {_POSITIONS} {_ROTATIONS}" if parent < 0 else f"3 {_ROTATIONS}"
    yield f"{indent}{kind} {motion.names[bone]}"
    yield f"{indent}{{"
    yield f"{indent}\tOFFSET {_in_cm(offset)}"
    yield f"{indent}\tCHANNELS {channels}"
    children = [child for child, above in enumerate(motion.parents) if above == bone]
    for child in children:
        yield from _joint(motion, child, "JOINT", depth + 1)
    if not children:
        end = motion.tails[bone] - motion.heads[bone]
        yield from (f"{indent}\tEnd Site", f"{indent}\t{{", f"{indent}\t\tOFFSET {_in_cm(end)}", f"{indent}\t}}")
    yield f"{indent}}}"


def _in_cm(vector: np.ndarray) -> str:
    return " ".join(f"{_CM * value:.8f}" for value in vector)


def _channels(motion: SkeletonMotion) -> np.ndarray:
    """Compute [T, channels] in the hierarchy's order, cm and degrees."""
    roots = [bone for bone, parent in enumerate(motion.parents) if parent < 0]
    columns = [np.zeros((len(motion.rotations), 6))] if len(roots) > 1 else []
    for bone in _in_order(motion.parents, -1):
        if motion.parents[bone] < 0:
            columns.append(_CM * motion.positions[:, bone])
        columns.append(np.rad2deg(euler_zxy(motion.rotations[:, bone])))
    return np.concatenate(columns, 1)


def _in_order(parents: tuple[int, ...], parent: int) -> Iterator[int]:
    for bone in (bone for bone, above in enumerate(parents) if above == parent):
        yield bone
        yield from _in_order(parents, bone)


def euler_zxy(rotations: np.ndarray) -> np.ndarray:
    """Convert rotations [T, 3, 3] = Rz Rx Ry to angles [T, 3] rad about z, x, y, each near those of the frame before.

    Of the two triples of a rotation, and of those whole turns away, the nearest is taken, so that programs that
    interpolate angles do not spin the bone.
    """
    sine = np.clip(rotations[:, 2, 1], -1, 1)
    x = np.arcsin(sine)
    is_locked = 1 - sine**2 < _LOCKED**2
    z = np.arctan2(-rotations[:, 0, 1], rotations[:, 1, 1])
    y = np.arctan2(-rotations[:, 2, 0], rotations[:, 2, 2])
    z = np.where(is_locked, np.arctan2(rotations[:, 1, 0], rotations[:, 0, 0]), z)
    angles = np.stack([z, x, np.where(is_locked, 0.0, y)], -1)
    for frame in range(1, len(angles)):
        own = angles[frame]
        other = np.array([own[0] + np.pi, np.pi - own[1], own[2] + np.pi])
        near = [each + 2 * np.pi * np.round((angles[frame - 1] - each) / (2 * np.pi)) for each in (own, other)]
        angles[frame] = min(near, key=lambda each, before=angles[frame - 1]: float(np.abs(each - before).sum()))
    return angles


BVH = Writer("bvh", "BVH", (".bvh",), _write)
