"""What our engine has of Cycles: its functions, its samples in a 3D view, and its render of the scene around the hands.

The base class cannot derive from `CyclesRender`: registering a class whose base is registered as well takes the base's
Python class away from Blender, and the engine Cycles renders black from then on ("unable to get Python class for RNA
struct 'CYCLES'", Blender 4.3 and 4.5). So it borrows the functions of `CyclesRender`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import bpy
from cycles import CyclesRender

from ...backend.records.errors import LiveHandError
from ...backend.render.composition import SceneLayer
from ..light.solids import MESH_LIKE
from ..rig.hand import hand_of_mesh
from .passes import ScenePasses

_GROUP, _SAMPLES = "cycles", "preview_samples"
_SEEN = {*MESH_LIKE, "CURVES", "POINTCLOUD", "VOLUME"}


class CyclesEngine(bpy.types.RenderEngine):
    """Renders what Cycles renders. It is not registered itself."""

    bl_use_eevee_viewport = True

    def __init__(self, *args, **kwargs):
        super().__init__(*args, **kwargs)
        self.session = None  # Cycles' own

    def __del__(self):
        # Blender has freed an engine that Python kept longer, as the traceback of a logged error does.
        with contextlib.suppress(ReferenceError):
            CyclesRender.__del__(self)

    update = CyclesRender.update
    render = CyclesRender.render
    render_frame_finish = CyclesRender.render_frame_finish
    view_update = CyclesRender.view_update
    view_draw = CyclesRender.view_draw
    update_render_passes = CyclesRender.update_render_passes


@contextlib.contextmanager
def one_sample(depsgraph: bpy.types.Depsgraph) -> Iterator[None]:
    """Make the evaluated scene ask for one sample in views, within; without Cycles' add-on it does nothing.

    The original scene does not change. The number is stored past Blender's properties: setting one would tag the scene
    as changed, so that the view would be updated, and Cycles restarted, without end.
    """
    scene = depsgraph.scene_eval
    if not hasattr(scene, _GROUP):
        yield
        return
    stored = _stored(scene)
    had_group = _GROUP in stored
    if not had_group:
        stored[_GROUP] = {}
    group = stored[_GROUP]
    before = group.get(_SAMPLES)
    group[_SAMPLES] = 1
    try:
        yield
    finally:
        if not had_group:
            del stored[_GROUP]
        elif before is None:
            del group[_SAMPLES]
        else:
            group[_SAMPLES] = before


def _stored(scene: bpy.types.Scene):
    """Return what holds the values of add-ons' properties: before Blender 5 the custom properties."""
    get = getattr(scene, "bl_system_properties_get", None)
    return scene if get is None else get(do_create=True)


def is_in_scene(scene: bpy.types.Scene) -> bool:
    """Return whether the hands are to be rendered in their scene.

    Raises:
        LiveHandError: Cycles is switched off.
    """
    if scene.livehand.mode != "SCENE":
        return False
    if not hasattr(scene, "cycles"):
        raise LiveHandError(
            "a hand in its scene needs Blender's Cycles add-on, which is switched off; "
            "enable it in the preferences, or set LiveHand to Hand Only"
        )
    return True


def has_only_hands(depsgraph: bpy.types.Depsgraph) -> bool:
    """Return whether only hands are wanted, or nothing else is there to be seen."""
    if depsgraph.scene.livehand.mode != "SCENE":
        return True
    return not any(
        instance.show_self and instance.object.type in _SEEN and hand_of_mesh(instance.object.original) is None
        for instance in depsgraph.object_instances
    )


def scene_layer(passes: ScenePasses) -> SceneLayer:
    """Return the colours and depths that hide the hands or lie behind them."""
    combined = passes["Combined"]
    return SceneLayer(combined[..., :3], combined[..., 3], passes["Depth"][..., 0])
