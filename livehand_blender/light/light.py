"""Reads the light of a Blender scene as the backend's `Light`: lamps, world and what stands in their way.

A frame's lamps, world and objects are read once for all its hands; then each hand gets what falls on it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import bpy
import numpy as np

from ...backend.records.light import Lamp, Light, Sky
from ..hands.shot import hand_vertices
from ..hands.visible_hands import InstanceId, VisibleHand
from .lamps import read_lamps
from .occluders import Occluders, occluders_of, read_solids
from .reach import AROUND_M, SUN_M, Reach, middle_of
from .solids import LocalTriangles, Solid
from .world import WorldLight, read_world


@dataclass(frozen=True)
class SceneLight:
    """The light on one hand; plain values, which may leave Blender's thread.

    Attributes:
        lamps: that light the hand.
        world: its radiance may have to be rendered first; None: no world.
        solids: objects that may shadow a hand of the frame, or reflect light on it.
        reach: where those stand that shadow this one.
        hand: its mesh object.
        exposure: factor of Cycles' film.
        is_final: whether it is for a frame that is kept.
    """

    lamps: tuple[Lamp, ...]
    world: WorldLight | None
    solids: tuple[Solid, ...]
    reach: Reach
    hand: InstanceId
    exposure: float
    is_final: bool

    @cached_property
    def occluders(self) -> Occluders:
        """The triangles that may shadow the hand or reflect light on it."""
        return occluders_of(self.solids, self.reach, self.hand)

    def light(self) -> Light:
        """Return the record. A world of nodes is rendered at the first call, which takes seconds.

        Raises:
            LiveHandError: the world cannot be rendered.
        """
        sky, suns = self.world.read() if self.world else (None, ())
        lamps = tuple(replace(lamp, rgb=lamp.rgb * self.exposure) for lamp in (*self.lamps, *suns))
        sky = sky and Sky(sky.radiance * self.exposure, sky.group)
        return Light(lamps, sky, *self.occluders, shadow_quality="fine" if self.is_final else "coarse")


def read_hand_lights(
    depsgraph: bpy.types.Depsgraph, hands: Sequence[VisibleHand], is_final: bool, local: LocalTriangles | None = None
) -> dict[str, SceneLight]:
    """Map each hand's name to the light on it; none if the scene says that hands keep their capture's.

    Args:
        depsgraph: of the frame.
        hands: of the frame.
        is_final: as in `read_scene_light`, which also tells what is raised.
        local: triangles that were read before; None: none were.
    """
    if depsgraph.scene.livehand.light != "SCENE":
        return {}
    lights = read_scene_light(
        depsgraph, {hand.instance_id: hand_vertices(hand, depsgraph) for hand in hands}, is_final, local
    )
    return {hand.name: lights[hand.instance_id] for hand in hands}


def read_scene_light(
    depsgraph: bpy.types.Depsgraph,
    hands: Mapping[InstanceId, np.ndarray],
    is_final: bool,
    local: LocalTriangles | None = None,
) -> dict[InstanceId, SceneLight]:
    """Read the light on each hand of an evaluated frame.

    Args:
        depsgraph: of the frame.
        hands: a hand's mesh object -> its vertices [V, 3] in the world, m.
        is_final: whether the frame is kept: its soft shadows are fine, and the render of the world is waited for, by
            which objects before its suns are found.
        local: triangles that were read before; None: none were.

    Raises:
        LiveHandError: the world cannot be rendered, or not be prepared for it.
    """
    linked, world = read_lamps(depsgraph), read_world(depsgraph)
    if world and is_final:
        world.read()
    suns, around_m = _reach_of_world(world)
    lamps = {
        mesh: tuple(filter(None, (one.for_mesh(mesh.name, middle_of(vertices)) for one in linked)))
        for mesh, vertices in hands.items()
    }
    reaches = {mesh: Reach.of(vertices, (*lamps[mesh], *suns), around_m) for mesh, vertices in hands.items()}
    solids = read_solids(depsgraph, reaches, local or LocalTriangles()) if reaches else ()
    cycles = getattr(depsgraph.scene_eval, "cycles", None)  # absent if Cycles is switched off
    exposure = cycles.film_exposure if cycles else 1.0
    return {one: SceneLight(lamps[one], world, solids, reaches[one], one, exposure, is_final) for one in hands}


def _reach_of_world(world: WorldLight | None) -> tuple[tuple[Lamp, ...], float]:
    """Return the world's suns, and how far from the hand objects shadow it from the sky or reflect light on it, m."""
    if world is None:
        return (), AROUND_M
    suns = world.rendered_suns
    return ((), SUN_M) if suns is None else (suns, AROUND_M)


def read_light(depsgraph: bpy.types.Depsgraph, mesh_name: str, vertices: np.ndarray) -> Light:
    """Read the light on one hand, by the full name of its mesh object and its vertices [V, 3] in the world, m.

    Raises:
        LiveHandError: the world cannot be read.
    """
    return read_scene_light(depsgraph, {InstanceId(mesh_name): vertices}, is_final=True)[InstanceId(mesh_name)].light()
