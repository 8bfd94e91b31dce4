"""A hand of a scene, resolved once: its armature, which side it is, the mesh it deforms and its hand model."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import bpy

from ...backend.hand.bones import bone_name, forearm_deform_name, forearm_name, root_name, target_name
from ...backend.hand.model import HandModel
from ...backend.hand.model_file import DEFAULT_HAND, load_hand_model
from ...backend.records.errors import LiveHandError
from ...backend.records.side import Side


@dataclass(frozen=True, eq=False)
class RiggedHand:
    """A hand's armature whose side is known and whose bones have been checked; create it with `of`.

    The mesh and the model are read when they are first needed, so that a hand whose model file is missing can still be
    posed. Like every reference to a Blender object, a `RiggedHand` must not outlive an undo step or a loaded file.

    Attributes:
        armature: the original object or an evaluated one.
        side: which hand it is.
    """

    armature: bpy.types.Object
    side: Side

    @classmethod
    def of(cls, armature: bpy.types.Object) -> RiggedHand:
        """Return the hand that an armature object is.

        Raises:
            LiveHandError: the object is not a LiveHand hand, or one of its bones is missing.
        """
        if armature.type != "ARMATURE" or not armature.livehand.is_hand:
            raise LiveHandError(f"{armature.name} is not a LiveHand hand; add one with Add > Armature > LiveHand Hand")
        side: Side = armature.livehand.side
        names = [bone_name(joint, side) for joint in range(16)] + [root_name(side)]
        if forearm_deform_name(side) in armature.pose.bones:
            names.append(forearm_name(side))
        missing = [name for name in names if name not in armature.pose.bones]
        if missing:
            raise LiveHandError(f"{armature.name} must keep its bones' names, missing: {', '.join(missing)}")
        return cls(armature, side)

    @classmethod
    def active(cls, context: bpy.types.Context) -> RiggedHand:
        """Find the context's active hand.

        Raises:
            LiveHandError: no hand is active, or one of its bones is missing.
        """
        armature = active_hand(context)
        if armature is None:
            raise LiveHandError("select a LiveHand hand first")
        return cls.of(armature)

    @classmethod
    def all_in(cls, scene: bpy.types.Scene) -> list[RiggedHand]:
        """List the hands of a scene, sorted by name.

        Raises:
            LiveHandError: a bone of a hand is missing.
        """
        return [cls.of(armature) for armature in find_hands(scene)]

    @property
    def properties(self) -> bpy.types.PropertyGroup:
        """The hand's settings, `Object.livehand`."""
        return self.armature.livehand

    @property
    def model_path(self) -> Path | None:
        """The hand model's file, relative to the .blend that owns the hand; None for a built-in hand."""
        path = self.properties.model_path
        return Path(bpy.path.abspath(path, library=self.armature.original.library)) if path else None

    @cached_property
    def mesh(self) -> bpy.types.Object:
        """The mesh that the armature deforms. Raises as `mesh_of`."""
        return mesh_of(self.armature.original)

    @cached_property
    def model(self) -> HandModel:
        """The hand model, of this hand's side. Raises LiveHandError if its file is not a hand model."""
        return load_hand_model(self.model_path or DEFAULT_HAND).for_side(self.side)

    def bone(self, joint: int) -> bpy.types.PoseBone:
        """Return the bone that the animator rotates for a joint (MANO's order)."""
        return self.armature.pose.bones[bone_name(joint, self.side)]

    @property
    def forearm(self) -> bpy.types.PoseBone | None:
        """The forearm's bone, the wrist's parent; None: the hand has no arm."""
        return self.armature.pose.bones.get(forearm_name(self.side))

    @property
    def bones(self) -> list[bpy.types.PoseBone]:
        """The bones that the animator rotates: those of the 16 joints, and the forearm if the hand has one."""
        joints = [self.bone(joint) for joint in range(16)]
        return joints if self.forearm is None else [*joints, self.forearm]

    def target(self, finger: str) -> bpy.types.PoseBone:
        """Return a finger's IK target."""
        return self.armature.pose.bones[target_name(finger, self.side)]

    def evaluated(self, depsgraph: bpy.types.Depsgraph) -> RiggedHand:
        """Return the same hand as evaluated in a depsgraph's frame."""
        return RiggedHand(self.armature.evaluated_get(depsgraph), self.side)


def active_hand(context: bpy.types.Context) -> bpy.types.Object | None:
    """Find the armature of the active hand: the active object, or the parent of the active mesh; unchecked."""
    active = context.active_object
    candidates = (active, active and active.parent)
    return next((thing for thing in candidates if thing is not None and thing.livehand.is_hand), None)


def find_hands(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """List the armatures of a scene's hands, sorted by name."""
    return sorted((thing for thing in scene.objects if thing.livehand.is_hand), key=lambda thing: thing.name)


def all_hands(scene: bpy.types.Scene) -> list[bpy.types.Object]:
    """List the armatures of a scene's hands, and of those in collections that it instances, sorted by name."""
    found: dict[int, bpy.types.Object] = {}
    _collect(scene.objects, found)
    return sorted(found.values(), key=lambda thing: thing.name)


def _collect(objects: Iterable[bpy.types.Object], found: dict[int, bpy.types.Object]) -> None:
    for thing in objects:
        if thing.livehand.is_hand:
            found[thing.as_pointer()] = thing
        elif thing.instance_type == "COLLECTION" and thing.instance_collection:
            _collect(thing.instance_collection.all_objects, found)


def hand_of_mesh(mesh: bpy.types.Object) -> bpy.types.Object | None:
    """Find the hand's armature whose mesh this object is; None if it is no hand's.

    Raises:
        LiveHandError: the hand deforms several meshes and none is chosen.
    """
    armature = mesh.find_armature()
    is_hands = armature is not None and armature.livehand.is_hand and mesh_of(armature) == mesh
    return armature if is_hands else None


def mesh_of(armature: bpy.types.Object) -> bpy.types.Object:
    """Find the mesh that a hand's armature deforms.

    A copy of the armature alone still refers to the first hand's mesh, so the mesh must also refer to the armature.

    Raises:
        LiveHandError: the hand has no mesh, or several and none is chosen.
    """
    mesh = armature.livehand.mesh
    if mesh is not None and is_skinned_to(mesh, armature):
        return mesh
    skinned = [child for child in armature.children_recursive if is_skinned_to(child, armature)]
    if len(skinned) != 1:
        names = f" ({', '.join(mesh.name_full for mesh in skinned)})" if skinned else ""
        raise LiveHandError(
            f"{armature.name} must have one mesh that it deforms, got {len(skinned)}{names}; choose it as Mesh in the "
            "LiveHand tab"
        )
    return skinned[0]


def is_skinned_to(thing: bpy.types.Object, armature: bpy.types.Object) -> bool:
    """Return whether an object is a mesh that this armature deforms."""
    return thing.type == "MESH" and thing.find_armature() == armature
