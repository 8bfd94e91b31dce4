"""The hands that a depsgraph's frame shows: those of its scene, and instances of hands in other collections."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import bpy
import numpy as np

from ..rig.hand import find_hands, hand_of_mesh, mesh_of


class Place(NamedTuple):
    """Tells the places of one object apart, within a frame and from frame to frame.

    Attributes:
        name: the object's full name.
        instancer: full name and number of what makes this instance of it; empty for the object itself.
    """

    name: str
    instancer: str = ""

    @classmethod
    def of(cls, instance: bpy.types.DepsgraphObjectInstance) -> Place:
        """The place of one of the depsgraph's instances."""
        name = instance.object.original.name_full
        if not instance.is_instance:
            return cls(name)
        numbers = ".".join(str(number) for number in instance.persistent_id if number < _NO_NUMBER)
        return cls(name, f"{instance.parent.original.name_full} {numbers}")


_NO_NUMBER = 2**31 - 1


@dataclass(frozen=True, eq=False)
class SeenHand:
    """A hand in one of the places in which a frame shows it.

    Attributes:
        armature: the original object.
        mesh: the original object.
        place: of the mesh.
        matrix: [4, 4] of the mesh, to the world.
    """

    armature: bpy.types.Object
    mesh: bpy.types.Object
    place: Place
    matrix: np.ndarray

    @property
    def name(self) -> str:
        """The armature's full name, with the instancer's if there is one; no other hand of the frame has it."""
        name = self.armature.name_full
        return f"{name} in {self.place.instancer}" if self.place.instancer else name

    @property
    def is_mirrored(self) -> bool:
        """Whether its scale turns the hand into one of the other side."""
        return bool(np.linalg.det(self.matrix[:3, :3]) < 0)

    def at(self, depsgraph: bpy.types.Depsgraph) -> SeenHand:
        """The hand in another frame; an instance that the frame does not have stays where it is."""
        if not self.place.instancer:
            return replace(self, matrix=np.array(self.mesh.evaluated_get(depsgraph).matrix_world))
        again = (np.array(one.matrix_world) for one in depsgraph.object_instances if Place.of(one) == self.place)
        return replace(self, matrix=next(again, self.matrix))


def visible_hands(depsgraph: bpy.types.Depsgraph) -> list[SeenHand]:
    """All hands whose mesh is visible in the depsgraph, sorted by name; the armature itself may be hidden.

    Raises:
        LiveHandError: a hand of the scene has no mesh.
    """
    for hand in find_hands(depsgraph.scene):
        mesh_of(hand)
    return sorted(_shown(depsgraph), key=lambda hand: hand.name)


def _shown(depsgraph: bpy.types.Depsgraph) -> Iterator[SeenHand]:
    """Instances are valid for one step of the iteration only, so no reference to them is kept."""
    armatures: dict[int, bpy.types.Object | None] = {}
    for instance in depsgraph.object_instances:
        mesh = instance.object.original
        if mesh.type == "MESH" and instance.show_self:
            key = mesh.as_pointer()
            if key not in armatures:
                armatures[key] = hand_of_mesh(mesh)
            armature = armatures[key]
            if armature is not None:
                yield SeenHand(armature, mesh, Place.of(instance), np.array(instance.matrix_world))
