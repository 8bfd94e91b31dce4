"""Poses the controls of another rig's hand frame by frame, so that its bones are where a motion wants them."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import bpy
import mathutils
import numpy as np

from ...backend.geometry.rotation import continuous, matrix_to_axis_angle
from ...backend.rigs.rest_alignment import shortest_rotation
from ...backend.rigs.sent_motion import SentMotion, bend_arm
from ...backend.rigs.source_skeleton import unit
from ..rig.keyframes import ROTATION_CHANNELS, key_channels, key_values
from ..rig.pose import set_rotation
from .controls import Arm, arm_switch, control_of, ik_control_of, is_keyed_by_hand
from .source import SourceRig, posed_skeleton, read_skeleton

_CORRECTIONS = 3  # of what constraints between a control and its bone have changed
_EXACT_RAD, _NEARER = 1e-4, 0.7


class _Control(NamedTuple):
    """A bone that is keyed.

    Attributes:
        bone: the bone.
        turn: [3, 3] at rest, from the bone that it moves to this one.
        offset: [3] m at rest, from that bone's head to this one's, in that bone's axes.
        is_placed: its location is keyed, too.
    """

    bone: bpy.types.PoseBone
    turn: np.ndarray
    offset: np.ndarray
    is_placed: bool = False


class RigPoser:
    """The controls of a rig's hand; `pose` poses them in a frame, `key` keys all that was posed.

    Raises:
        LiveHandError: a bone is missing, or an arm in IK has no control.
    """

    def __init__(self, context: bpy.types.Context, rig: SourceRig, arm: Arm):
        self._context, self._rig = context, rig
        self._arm: Arm = arm
        self._rest = read_skeleton(rig.armature)
        joint_map = rig.joint_map
        self._joints = {joint: self._control(bone) for joint, bone in enumerate(joint_map.bones) if bone}
        self._forearm, self._upper = None, None
        if arm == "IK":
            name = ik_control_of(rig.armature, joint_map.drivers[0])
            self._joints[0] = self._control(joint_map.drivers[0], name, is_placed=True)
        elif joint_map.forearm:
            above = rig.armature.pose.bones[control_of(rig.armature, joint_map.forearm)].parent
            self._forearm = self._control(joint_map.forearm, is_placed=above is None)
            self._upper = above
        elif not self._joints[0].bone.bone.use_connect:
            self._joints[0] = self._joints[0]._replace(is_placed=True)
        self._palm = self._metacarpals()
        self._switch = arm_switch(rig.armature, joint_map.drivers[0])
        self._values: dict[str, list[tuple[np.ndarray, np.ndarray]]] = {bone.name: [] for bone in self._bones()}

    @property
    def count(self) -> int:
        """How many bones are keyed."""
        return len(self._values)

    def pose(self, frame: int, wanted: SentMotion, index: int) -> float:
        """Pose the controls in a frame of the scene as the motion is at an index; returns what the arm misses, m."""
        self._context.scene.frame_set(frame)
        if self._switch:
            self._rig.armature.pose.bones[self._switch.bone][self._switch.name] = self._switch.value(self._arm)
        for bone in self._palm:
            set_rotation(bone, np.array([1.0, 0, 0, 0]))
        self._update()
        missed_m = self._reach(wanted, index)
        self._settle(wanted.frames[index], wanted.wrists[index])
        for bone in self._bones():
            rotation = np.array(getattr(bone, _channel(bone)), np.float64)
            self._values[bone.name].append((rotation, np.array(bone.location, np.float64)))
        return missed_m

    def key(self, frames: Sequence[int]) -> None:
        """Key what was posed in these frames."""
        armature, at = self._rig.armature, np.asarray(frames, np.float64)
        placed = {control.bone.name for control in self._all() if control.is_placed}
        for bone in self._bones():
            rotations, locations = (np.array(values) for values in zip(*self._values[bone.name], strict=True))
            is_quaternion = bone.rotation_mode == "QUATERNION"
            key_channels(armature, bone, _channel(bone), at, continuous(rotations) if is_quaternion else rotations)
            if bone.name in placed:
                key_channels(armature, bone, "location", at, locations)
        if self._switch:
            ends = np.unique(at[[0, -1]])
            bone, name = self._switch.bone, self._switch.name
            path = f'{armature.pose.bones[bone].path_from_id()}["{name}"]'
            key_values(armature, path, bone, ends, np.full(len(ends), self._switch.value(self._arm)))

    @contextlib.contextmanager
    def channels_restored(self) -> Iterator[None]:
        """Restore the channels of all controls afterwards."""
        before = {
            bone.name: (list(getattr(bone, _channel(bone))), list(bone.location))
            for bone in (*self._bones(), *self._palm)
        }
        switch = self._switch
        bones = self._rig.armature.pose.bones
        switched = bones[switch.bone][switch.name] if switch else None
        try:
            yield
        finally:
            for name, (rotation, location) in before.items():
                setattr(bones[name], _channel(bones[name]), rotation)
                bones[name].location = location
            if switch:
                bones[switch.bone][switch.name] = switched
            self._rig.armature.update_tag()

    def _control(self, moved: str, name: str | None = None, is_placed: bool = False) -> _Control:
        """Find the control of a bone, or take the one of this name."""
        name = name or control_of(self._rig.armature, moved)
        rest, one, other = self._rest, self._rest.index(moved), self._rest.index(name)
        turn = rest.frames[one].T @ rest.frames[other]
        offset = rest.frames[one].T @ (rest.heads[other] - rest.heads[one])
        return _Control(self._rig.armature.pose.bones[name], turn, offset, is_placed)

    def _metacarpals(self) -> list[bpy.types.PoseBone]:
        """List the controls of bones between the wrist and the fingers, which have no joint in MANO."""
        rest, drivers = self._rest, self._rig.joint_map.drivers
        bones = self._rig.armature.pose.bones
        between: dict[str, None] = {}
        for joint in (1, 4, 7, 10, 13):
            above = [rest.names[bone] for bone in rest.ancestors(rest.index(drivers[joint]))]
            if drivers[0] in above:
                between |= dict.fromkeys(above[: above.index(drivers[0])])
        names = dict.fromkeys(control_of(self._rig.armature, name) for name in between)
        used = {control.bone.name for control in self._joints.values()}
        return [bones[name] for name in names if name not in used and is_keyed_by_hand(bones[name])]

    def _all(self) -> list[_Control]:
        return [*([self._forearm] if self._forearm else []), *self._joints.values()]

    def _bones(self) -> list[bpy.types.PoseBone]:
        """List all bones that are keyed."""
        upper = [self._upper] if self._upper else []
        return [*upper, *(control.bone for control in self._all()), *self._palm]

    def _update(self) -> None:
        self._rig.armature.update_tag()
        self._context.view_layer.update()

    def _reach(self, wanted: SentMotion, index: int) -> float:
        """Bring the wrist to its place by the arm in FK; returns what is missing, m."""
        if self._forearm is None:
            return 0.0
        rest, joint_map, wrist = self._rest, self._rig.joint_map, wanted.wrists[index]
        begin, end = (rest.heads[rest.index(name)] for name in (self._forearm.bone.name, joint_map.drivers[0]))
        lower = float(np.linalg.norm(end - begin))
        frame, elbow = self._forearm_of(wanted, index)
        if self._upper is None:
            turned = frame @ rest.frames[rest.index(str(joint_map.forearm))].T
            self._set(self._forearm, frame, wrist + turned @ (begin - end))
            self._update()
            return 0.0
        set_rotation(self._upper, np.array([1.0, 0, 0, 0]))
        self._update()
        upper = float(np.linalg.norm(begin - rest.heads[rest.index(self._upper.name)]))
        shoulder, present = (self._head(bone) for bone in (self._upper, self._forearm.bone))
        arm = bend_arm(shoulder, wrist, (upper, lower), elbow)
        swing = shortest_rotation(unit(present - shoulder), unit(arm.elbow - shoulder))
        self._rotate(self._upper, swing @ self._frame(self._upper))
        self._update()
        swing = shortest_rotation(elbow, unit(arm.elbow - wrist))
        self._set(self._forearm, swing @ frame, None)
        self._update()
        return arm.missed_m

    def _forearm_of(self, wanted: SentMotion, index: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the forearm's frame [3, 3] and the elbow's direction [3] from the wrist; as at rest without an arm."""
        if wanted.forearms is not None and wanted.elbows is not None:
            return wanted.forearms[index], wanted.elbows[index]
        rest, joint_map = self._rest, self._rig.joint_map
        hand, arm = (rest.index(str(name)) for name in (joint_map.drivers[0], joint_map.forearm))
        turned = wanted.frames[index, 0] @ rest.frames[hand].T
        return turned @ rest.frames[arm], turned @ unit(rest.heads[arm] - rest.heads[hand])

    def _settle(self, frames: np.ndarray, wrist: np.ndarray) -> None:
        """Turn the joints' controls until their bones have frames [16, 3, 3], as far as the rig lets them.

        What does not bring a bone nearer is undone: controls that aim a bone, as Rigify's at a finger's first, do not
        twist it.
        """
        targets = {joint: frames[joint] for joint in self._joints}
        self._turn_joints(targets, wrist)
        off = self._off(frames)
        for _ in range(_CORRECTIONS):
            if max(map(_angle_rad, off.values())) < _EXACT_RAD:
                return
            tried = {joint: off[joint] @ target for joint, target in targets.items()}
            self._turn_joints(tried, wrist)
            now = self._off(frames)
            is_nearer = {joint: _angle_rad(now[joint]) < _NEARER * _angle_rad(off[joint]) for joint in off}
            targets = {joint: tried[joint] if is_nearer[joint] else targets[joint] for joint in targets}
            if not all(is_nearer.values()):
                self._turn_joints(targets, wrist)
                now = self._off(frames)
            if not any(is_nearer.values()):
                return
            off = now

    def _turn_joints(self, targets: dict[int, np.ndarray], wrist: np.ndarray) -> None:
        """Turn the joints' controls so that their bones have frames [3, 3], from the wrist to the fingertips."""
        for level in ((0,), (1, 4, 7, 10, 13), (2, 5, 8, 11, 14), (3, 6, 9, 12, 15)):
            for joint in level:
                if joint in self._joints:
                    self._set(self._joints[joint], targets[joint], wrist if joint == 0 else None)
            self._update()

    def _off(self, frames: np.ndarray) -> dict[int, np.ndarray]:
        """Compute the rotations [3, 3] that joints' bones lack to frames [16, 3, 3]."""
        evaluated = self._rig.armature.evaluated_get(self._context.evaluated_depsgraph_get())
        posed = posed_skeleton(evaluated, self._rig.joint_map)
        drivers = self._rig.joint_map.drivers
        return {joint: frames[joint] @ posed.frames[posed.index(drivers[joint])].T for joint in self._joints}

    def _set(self, control: _Control, frame: np.ndarray, head: np.ndarray | None) -> None:
        """Give the bone that a control moves a frame [3, 3], and a head [3] m where the control's location is keyed."""
        place = head + frame @ control.offset if head is not None and control.is_placed else None
        self._rotate(control.bone, frame @ control.turn, place)

    def _rotate(self, bone: bpy.types.PoseBone, frame: np.ndarray, head: np.ndarray | None = None) -> None:
        """Give a bone a frame [3, 3] in the world, and a head [3] m, or leave its location."""
        armature = self._rig.armature
        world = np.array(armature.matrix_world, np.float64)
        linear = world[:3, :3] / np.linalg.norm(world[:3, :3], axis=0)
        wanted = np.array(bone.matrix, np.float64)
        wanted[:3, :3] = linear.T @ frame
        if head is not None:
            wanted[:3, 3] = np.linalg.solve(world[:3, :3], head - world[:3, 3])
        own = armature.convert_space(
            pose_bone=bone, matrix=mathutils.Matrix(wanted.tolist()), from_space="POSE", to_space="LOCAL"
        )
        values = self._values[bone.name]
        if values:  # so that Euler angles are near those of the frame before
            setattr(bone, _channel(bone), values[-1][0].tolist())
        set_rotation(bone, np.array(own.to_quaternion(), np.float64))
        if head is not None:
            bone.location = own.translation

    def _head(self, bone: bpy.types.PoseBone) -> np.ndarray:
        return np.array(self._rig.armature.matrix_world @ bone.head, np.float64)

    def _frame(self, bone: bpy.types.PoseBone) -> np.ndarray:
        """Return [3, 3] a bone's present frame in the world."""
        posed = np.array((self._rig.armature.matrix_world @ bone.matrix).to_3x3(), np.float64)
        return posed / np.linalg.norm(posed, axis=0)


def _angle_rad(rotation: np.ndarray) -> float:
    return float(np.linalg.norm(matrix_to_axis_angle(rotation)))


def _channel(bone: bpy.types.PoseBone) -> str:
    return ROTATION_CHANNELS.get(bone.rotation_mode, "rotation_euler")
