"""The things of a scene that a hand grasps -> solids in the hand's own space, evaluated and scaled as they are."""

from __future__ import annotations

from collections.abc import Sequence

import bpy
import numpy as np

from ...backend.contact.placed_solids import PlacedSolid
from ...backend.contact.solid import MeshSolid
from ...backend.records.errors import LiveHandError
from ..light.solids import MESH_LIKE, LocalTriangles
from ..rig.hand import RiggedHand, find_hands, mesh_of

_SAME_SCALE = 1e-3  # share by which the scales of a hand's axes may differ


def selected_targets(context: bpy.types.Context, hand: RiggedHand) -> list[bpy.types.Object]:
    """List the selected objects that a hand can grasp: others than itself; of other hands, their meshes.

    Raises:
        LiveHandError: there is none, or one has no faces by its kind.
    """
    own = {hand.armature, hand.mesh}
    hands = find_hands(context.scene)
    chosen = [thing for thing in context.view_layer.objects.selected if thing not in own]
    targets = [mesh_of(thing) if thing in hands else thing for thing in chosen]
    wrong = [thing.name for thing in targets if thing.type not in MESH_LIKE]
    if wrong:
        raise LiveHandError(f"what is grasped must have faces, {', '.join(wrong)} has none; deselect it")
    if not targets:
        raise LiveHandError(
            "an object to grasp must be selected beside the hand, none is; click it, then Shift-click the hand"
        )
    return list(dict.fromkeys(targets))


class Targets:
    """Objects that a hand grasps, whose solids are made again only when their meshes change."""

    def __init__(self, objects: Sequence[bpy.types.Object]):
        """Take the original objects."""
        self._objects = tuple(objects)
        self._kept: dict[str, tuple[np.ndarray, MeshSolid]] = {}

    def placed(self, hand: RiggedHand, depsgraph: bpy.types.Depsgraph) -> list[PlacedSolid]:
        """Place them in a hand's own space, in the depsgraph's frame.

        Raises:
            LiveHandError: the hand is mirrored or scaled differently along its axes, or an object has no faces.
        """
        to_hand = np.linalg.inv(_unmirrored(hand, depsgraph))
        return [self._placed(thing, to_hand, depsgraph) for thing in self._objects]

    def _placed(self, thing: bpy.types.Object, to_hand: np.ndarray, depsgraph: bpy.types.Depsgraph) -> PlacedSolid:
        evaluated = thing.evaluated_get(depsgraph)
        matrix = to_hand @ np.array(evaluated.matrix_world, np.float64)
        turn, sizes, axes = np.linalg.svd(matrix[:3, :3])
        scaled = LocalTriangles().of(evaluated).reshape(-1, 3) @ (axes.T * sizes) @ axes
        kept = self._kept.get(thing.name_full)
        if kept is None or kept[0].shape != scaled.shape or not np.allclose(kept[0], scaled, rtol=0, atol=1e-7):
            try:
                solid = MeshSolid(scaled, np.arange(len(scaled)).reshape(-1, 3))
            except LiveHandError as error:
                raise LiveHandError(f"{thing.name}: {error}") from error
            kept = self._kept[thing.name_full] = scaled, solid
        return PlacedSolid(kept[1], turn @ axes, matrix[:3, 3], thing.name)


def _unmirrored(hand: RiggedHand, depsgraph: bpy.types.Depsgraph) -> np.ndarray:
    matrix = np.array(hand.armature.evaluated_get(depsgraph).matrix_world, np.float64)
    sizes = np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(matrix[:3, :3]) <= 0 or np.ptp(sizes) > _SAME_SCALE * sizes.max():
        raise LiveHandError(
            f"{hand.armature.name} must be scaled by one positive number to grasp, got "
            f"{', '.join(f'{size:.3g}' for size in sizes)}; apply its scale first"
        )
    return matrix
