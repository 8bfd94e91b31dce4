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
        is_holdout: whether it leaves a hole in the picture.
    """

    armature: bpy.types.Object
    mesh: bpy.types.Object
    instance_id: InstanceId
    matrix: np.ndarray
    is_holdout: bool = False

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
    """Find all hands whose mesh the camera may see in the depsgraph, sorted by name; the armature itself may be hidden.

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
        if mesh.type == "MESH" and meets_camera_rays(instance, depsgraph.view_layer):
            key = mesh.as_pointer()
            if key not in armatures:
                armatures[key] = hand_of_mesh(mesh)
            armature = armatures[key]
            if armature is not None:
                is_held = is_holdout(instance, depsgraph.view_layer)
                yield VisibleHand(armature, mesh, InstanceId.of(instance), np.array(instance.matrix_world), is_held)


def meets_camera_rays(instance: bpy.types.DepsgraphObjectInstance, layer: bpy.types.ViewLayer) -> bool:
    """Return whether camera rays meet an instance: it is shown, and neither its rays nor its collection forbid it.

    The original objects are asked, because evaluated ones may be hidden from the camera for a render.
    """
    if not instance.show_self:
        return False
    thing, maker = instance.object.original, _maker_of(instance)
    if not (thing.visible_camera and maker.visible_camera):
        return False
    return is_holdout(instance, layer) or not maker.indirect_only_get(view_layer=layer)


def is_holdout(instance: bpy.types.DepsgraphObjectInstance, layer: bpy.types.ViewLayer) -> bool:
    """Return whether an instance leaves a hole in the picture, by its own setting or by its collection's."""
    maker = _maker_of(instance)
    return instance.object.original.is_holdout or maker.is_holdout or maker.holdout_get(view_layer=layer)


def _maker_of(instance: bpy.types.DepsgraphObjectInstance) -> bpy.types.Object:
    """Return the object of the view layer that the instance is, or by which it is made."""
    return instance.parent.original if instance.is_instance else instance.object.original
