"""The hands that a depsgraph's frame shows: those of its scene, and instances of hands in other collections."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import bpy
import numpy as np

from ..rig.hand import find_hands, hand_of_mesh, mesh_of


class InstanceId(NamedTuple):
    """Identify one instance of an object, within a frame and from frame to frame.

    Attributes:
        name: the object's full name.
        instancer: full name and number of what makes this instance of it; empty for the object itself.
    """

    name: str
    instancer: str = ""

    @classmethod
    def of(cls, instance: bpy.types.DepsgraphObjectInstance) -> InstanceId:
        """Identify one of the depsgraph's instances."""
        name = instance.object.original.name_full
        if not instance.is_instance:
            return cls(name)
        numbers = ".".join(str(number) for number in instance.persistent_id if number < _NO_NUMBER)
        return cls(name, f"{instance.parent.original.name_full} {numbers}")


_NO_NUMBER = 2**31 - 1


@dataclass(frozen=True, eq=False)
class VisibleHand:
    """One instance of a hand that a frame shows.

    Attributes:
        armature: the original object.
        mesh: the original object.
        instance_id: of the mesh.
        matrix: [4, 4] of the mesh, to the world.
    """

    armature: bpy.types.Object
    mesh: bpy.types.Object
    instance_id: InstanceId
    matrix: np.ndarray

    @property
    def name(self) -> str:
        """The armature's full name, with the instancer's if there is one; no other hand of the frame has it."""
        name = self.armature.name_full
        return f"{name} in {self.instance_id.instancer}" if self.instance_id.instancer else name

    @property
    def is_mirrored(self) -> bool:
        """Whether its scale turns the hand into one of the other side."""
        return bool(np.linalg.det(self.matrix[:3, :3]) < 0)


def visible_hands(depsgraph: bpy.types.Depsgraph) -> tuple[VisibleHand, ...]:
    """Find all hands whose mesh is visible in the depsgraph, sorted by name; the armature itself may be hidden.

    This iterates all instances of the frame, in Python: read the hands once a frame, and hand them on.

    Raises:
        LiveHandError: a hand of the scene has no mesh.
    """
    for hand in find_hands(depsgraph.scene):
        mesh_of(hand)
    return tuple(sorted(_hand_instances(depsgraph), key=lambda hand: hand.name))


def hands_at(hands: Sequence[VisibleHand], depsgraph: bpy.types.Depsgraph) -> tuple[VisibleHand, ...]:
    """Move hands to where the depsgraph's frame has them; an instance that it lacks stays where it is."""
    matrices = _instance_matrices(depsgraph, {hand.instance_id.name for hand in hands if hand.instance_id.instancer})
    return tuple(
        replace(hand, matrix=matrices.get(hand.instance_id, hand.matrix))
        if hand.instance_id.instancer
        else replace(hand, matrix=np.array(hand.mesh.evaluated_get(depsgraph).matrix_world))
        for hand in hands
    )


def _instance_matrices(depsgraph: bpy.types.Depsgraph, names: set[str]) -> dict[InstanceId, np.ndarray]:
    """Read the matrix [4, 4] of each instance of the objects of these full names."""
    if not names:
        return {}
    return {
        InstanceId.of(instance): np.array(instance.matrix_world)
        for instance in depsgraph.object_instances
        if instance.is_instance and instance.object.original.name_full in names
    }


def _hand_instances(depsgraph: bpy.types.Depsgraph) -> Iterator[VisibleHand]:
    """Yield hands; instances are valid for one step of the iteration only, so no reference to them is kept."""
    armatures: dict[int, bpy.types.Object | None] = {}
    for instance in depsgraph.object_instances:
        mesh = instance.object.original
        if mesh.type == "MESH" and instance.show_self:
            key = mesh.as_pointer()
            if key not in armatures:
                armatures[key] = hand_of_mesh(mesh)
            armature = armatures[key]
            if armature is not None:
                yield VisibleHand(armature, mesh, InstanceId.of(instance), np.array(instance.matrix_world))
