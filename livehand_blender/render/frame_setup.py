"""Reads a frame's description from the depsgraph: its hands, their work in every view, and the passes to write."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import bpy
import numpy as np

from ...backend.avatars.origin import read_origin
from ...backend.image.exposure import SHARP, ExposureSample, Lens, Shutter, camera_of_sample, exposure_samples
from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.records.light import Light
from ...backend.render.frame_task import FrameTask, HandInstance, HandRenderer, HandTask
from ...backend.render.session import Device, Session
from ...backend.render.splats.lit_hand import LitHand
from ..hands.shot import hand_vertices, read_shot
from ..hands.visible_hands import InstanceId, VisibleHand, hands_at, visible_hands
from ..light.light import read_hand_lights
from ..motion.frames import current_frame_restored
from ..rig.hand import all_hands
from ..scene.camera import Eye, read_camera, render_region
from .cycles import is_in_scene
from .hand_source import HandSource, hand_source, load_for, load_renderer_in_blender, read_device, read_grade
from .light_groups import light_groups
from .passes import SURFACE_PASSES, Pass, cryptomatte_passes, wanted_passes
from .picture_origin import read_payload

LOGGER = logging.getLogger(__name__)

_ANY_CAMERA = Camera(np.eye(3), np.eye(4), (64, 64))
_Pair = tuple[HandInstance, VisibleHand]
"""A hand of the frame's tasks, and the same hand in the scene."""


@dataclass(frozen=True)
class ViewSetup:
    """One view of a frame: an eye of a stereo render, or the only view, whose name is empty.

    Its `motion` [V, 4], px, of each hand's vertices is that of `SurfaceMaps`; None if no pass needs it.
    """

    name: str
    task: FrameTask
    motion: tuple[np.ndarray, ...] | None = None


@dataclass(frozen=True)
class FrameSetup:
    """All that the render of a view layer's frame needs once the depsgraph is gone.

    Attributes:
        scene: the original one, for its colour management.
        layer: the view layer's name.
        size_px: (width, height) of the rendered region.
        passes: those that the layer has switched on.
        cryptomatte: names of the Cryptomatte passes that the layer has switched on.
        light_groups: names of the layer's light groups.
        is_in_scene: whether Cycles renders the scene around the hands.
        hands: in the order of every sample's tasks.
        albedo: of each hand whose avatar has one, unless it is an instance: full name of its mesh -> mean albedo [3];
            empty without a scene.
        meshes: name of each of those hands -> full name of its mesh.
        instance_ids: of every hand's mesh.
        surface_vertices: full name of such a mesh -> [V, 3] world, its vertices on the avatar's surface, if it has one.
        views: one, or two eyes.
        watermark: 8 bytes for the picture; None: none is wanted.
    """

    scene: bpy.types.Scene
    layer: str
    size_px: tuple[int, int]
    passes: tuple[Pass, ...]
    cryptomatte: tuple[str, ...]
    light_groups: tuple[str, ...]
    is_in_scene: bool
    hands: tuple[HandInstance, ...]
    albedo: Mapping[str, np.ndarray]
    meshes: Mapping[str, str]
    instance_ids: tuple[InstanceId, ...]
    views: tuple[ViewSetup, ...]
    surface_vertices: Mapping[str, np.ndarray] = field(default_factory=dict)
    watermark: bytes | None = None

    @property
    def needs_surface(self) -> bool:
        """Whether a pass needs the surface maps of the hands' meshes."""
        return any(one.name in SURFACE_PASSES for one in self.passes)


@dataclass(frozen=True)
class VisibleHands:
    """The hands of a frame, read once, and the files of their renderers."""

    visible: tuple[VisibleHand, ...]
    sources: tuple[HandSource, ...]
    device: Device

    @classmethod
    def read(cls, depsgraph: bpy.types.Depsgraph) -> VisibleHands:
        """Read the hands that the depsgraph's frame shows.

        Raises:
            LiveHandError: a hand of the scene has no mesh.
        """
        visible = visible_hands(depsgraph)
        return cls(visible, tuple(hand_source(hand.armature) for hand in visible), read_device(depsgraph.scene))

    def load(self, session: Session) -> tuple[HandRenderer, ...]:
        """Load the renderers that are not loaded, in any thread; raises LiveHandError if an avatar is at fault."""
        return tuple(
            load_for(hand.name, source, session, self.device)
            for hand, source in zip(self.visible, self.sources, strict=True)
        )

    def instances(self, depsgraph: bpy.types.Depsgraph, session: Session) -> tuple[HandInstance, ...]:
        """Pair each hand with its renderer and its grade.

        Raises:
            LiveHandError: the scene has no hand, or an avatar is at fault.
        """
        if not all_hands(depsgraph.scene):
            raise LiveHandError(
                "a render needs a LiveHand hand, the scene has none; add one (Add > Armature > LiveHand Hand)"
            )
        return tuple(
            HandInstance(
                hand.name,
                hand.mesh.name,
                renderer,
                read_grade(hand.armature.evaluated_get(depsgraph)),
                hand.is_holdout,
            )
            for hand, renderer in zip(self.visible, self.load(session), strict=True)
        )


def read_frame_setup(
    engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, frame_hands: VisibleHands, session: Session
) -> FrameSetup:
    """Read the depsgraph's frame, and, if it is blurred, times a little before and after.

    Args:
        engine: sets frames and stereo views.
        depsgraph: of the frame, to which it is set back.
        frame_hands: those of the frame.
        session: loads the avatars that are not loaded.

    Raises:
        LiveHandError: the scene has no hand, or a hand, an avatar, the camera or the border is at fault.
    """
    scene, layer = depsgraph.scene, depsgraph.view_layer
    size_px, in_scene = render_region(scene.render).size_px, is_in_scene(scene)
    hands, visible = frame_hands.instances(depsgraph, session), frame_hands.visible
    if cryptomatte_passes(layer):
        _check_names(visible)
    pairs = tuple(zip(hands, visible, strict=True))
    lights = _read_lights(depsgraph, pairs)
    reflecting = _reflecting(pairs) if in_scene else {}
    views = tuple(
        ViewSetup(
            name,
            _read_task(engine, depsgraph, pairs, lights, is_stereo=bool(name)),
            _read_motion(engine, depsgraph, visible, is_stereo=bool(name)),
        )
        for name in _activated_views(engine, scene.render)
    )
    return FrameSetup(
        scene=scene,
        layer=layer.name,
        size_px=size_px,
        passes=wanted_passes(layer),
        cryptomatte=cryptomatte_passes(layer),
        light_groups=light_groups(layer),
        is_in_scene=in_scene,
        hands=hands,
        albedo={mesh: albedo for mesh, albedo in reflecting.values()},
        meshes={name: mesh for name, (mesh, _) in reflecting.items()},
        instance_ids=tuple(hand.instance_id for hand in visible),
        views=views,
        watermark=read_payload(scene, hands, session),
    )


def read_frame_task(engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, session: Session) -> FrameTask:
    """Read the task of the depsgraph's frame, without stereo; raises as `read_frame_setup`."""
    hands = VisibleHands.read(depsgraph)
    pairs = tuple(zip(hands.instances(depsgraph, session), hands.visible, strict=True))
    return _read_task(engine, depsgraph, pairs, _read_lights(depsgraph, pairs), is_stereo=False)


def lit_frames(
    context: bpy.types.Context, frames: Iterable[int], is_chosen: Callable[[LitHand], bool]
) -> dict[int, tuple[LitHand, ...]]:
    """Read the chosen hands of the scene in frames, by number; their renderers are loaded.

    Raises:
        LiveHandError: there is no frame, a frame has no such hand, or a hand or an avatar is at fault.
    """
    session, scene, found = Session(load_renderer_in_blender), context.scene, {}
    with current_frame_restored(scene):
        for frame in frames:
            scene.frame_set(frame)
            hands = _read_lit_hands(context.evaluated_depsgraph_get(), session, _ANY_CAMERA)
            found[frame] = tuple(hand for hand in hands if is_chosen(hand))
    if not found or not all(found.values()):
        missing = [frame for frame, hands in found.items() if not hands]
        raise LiveHandError(f"splats need a visible hand in every frame, got none in {missing[:5] or 'an empty range'}")
    return found


def _read_lit_hands(depsgraph: bpy.types.Depsgraph, session: Session, camera: Camera) -> tuple[LitHand, ...]:
    """Read the hands of the depsgraph's frame, in its light; raises as `read_frame_setup`."""
    hands = VisibleHands.read(depsgraph)
    pairs = tuple(zip(hands.instances(depsgraph, session), hands.visible, strict=True))
    tasks = _read_hands(depsgraph, pairs, _read_lights(depsgraph, pairs), camera)
    origins = (read_origin(source.avatar_path) for source in hands.sources)
    return tuple(
        LitHand(task.renderer, task.shot, origin, hand.grade, hand.name)
        for task, origin, (hand, _) in zip(tasks, origins, pairs, strict=True)
    )


def _read_lights(depsgraph: bpy.types.Depsgraph, hands: Sequence[_Pair]) -> dict[str, Light]:
    """Map each hand that takes the scene's light, by name, to the light on it at the frame itself."""
    lit = [visible for hand, visible in hands if hand.renderer.is_relightable]
    if not lit:
        return {}
    lights = {name: one.light() for name, one in read_hand_lights(depsgraph, lit, is_final=True).items()}
    if not is_in_scene(depsgraph.scene):  # objects that emit may light it there
        for name in (name for name, light in lights.items() if light.is_dark):
            LOGGER.warning(
                "No light and no world lights '%s': it is black. Add a light or Studio Lights, or set Light to "
                "Capture's Own",
                name,
            )
    return lights


def _reflecting(hands: Sequence[_Pair]) -> dict[str, tuple[str, np.ndarray]]:
    """Map a hand's name to its full mesh name and albedo [3], unless it is an instance or its avatar has no albedo."""
    own = [(visible, hand.renderer.mean_albedo) for hand, visible in hands if not visible.instance_id.instancer]
    return {hand.name: (hand.instance_id.name, albedo) for hand, albedo in own if albedo is not None}


def _check_names(hands: Sequence[VisibleHand]) -> None:
    """Check that two hands' meshes share no name: Cryptomatte knows an object by its name without its library."""
    by_mesh: dict[str, VisibleHand] = {}
    for hand in hands:
        other = by_mesh.setdefault(hand.mesh.name, hand)
        if other.mesh != hand.mesh:
            raise LiveHandError(
                "Cryptomatte tells objects apart by their names, and the meshes of "
                f"'{other.name}' and '{hand.name}' are both called '{hand.mesh.name}'; rename one, or turn the view "
                "layer's Cryptomatte off"
            )


def _activated_views(engine: bpy.types.RenderEngine, render: bpy.types.RenderSettings) -> Iterator[str]:
    """Yield the name of each stereo view, after activating it; without stereo one empty name."""
    if not render.use_multiview:
        yield ""
        return
    for view in render.views:
        if view.use:
            engine.active_view_set(view.name)
            yield view.name


def _read_task(
    engine: bpy.types.RenderEngine,
    depsgraph: bpy.types.Depsgraph,
    hands: Sequence[_Pair],
    lights: Mapping[str, Light],
    is_stereo: bool,
) -> FrameTask:
    """Read the hands and the camera at every exposure sample."""
    camera, lens = _read_view(engine, depsgraph, is_stereo)
    samples = read_exposure(depsgraph.scene, lens) if hands else ()
    if samples == (SHARP,):
        return FrameTask((_read_hands(depsgraph, hands, lights, camera),))
    tasks = []
    frame, offset = depsgraph.scene.frame_current, 0.0
    try:
        for sample in samples:
            if sample.offset_frames != offset:
                offset = sample.offset_frames
                whole = int(offset // 1)
                engine.frame_set(frame + whole, offset - whole)
            camera, lens = _read_view(engine, depsgraph, is_stereo)
            moved = hands_at([visible for _, visible in hands], depsgraph)
            pairs = [(hand, one) for (hand, _), one in zip(hands, moved, strict=True)]
            tasks.append(_read_hands(depsgraph, pairs, lights, camera_of_sample(camera, lens, sample)))
    finally:
        if offset != 0.0:
            engine.frame_set(frame, 0.0)
    return FrameTask(tuple(tasks))


def _read_motion(
    engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, hands: Sequence[VisibleHand], is_stereo: bool
) -> tuple[np.ndarray, ...] | None:
    """Read the motion of each hand's vertices in the image, as Cycles defines it; there is none beside motion blur."""
    scene = depsgraph.scene
    if not depsgraph.view_layer.use_pass_vector or scene.render.use_motion_blur:
        return None
    frame, positions_px = scene.frame_current, []
    try:
        for offset in (-1, 0, 1):
            engine.frame_set(frame + offset, 0.0)
            camera, _ = _read_view(engine, depsgraph, is_stereo)
            moved = hands_at(hands, depsgraph)
            positions_px.append([camera.project(hand_vertices(hand, depsgraph))[0] for hand in moved])
    finally:
        engine.frame_set(frame, 0.0)
    up = np.array([1.0, -1.0])  # Blender's rows begin at the bottom
    return tuple(
        np.concatenate([(before - now) * up, (now - after) * up], 1)
        for before, now, after in zip(*positions_px, strict=True)
    )


def _read_view(
    engine: bpy.types.RenderEngine, depsgraph: bpy.types.Depsgraph, is_stereo: bool
) -> tuple[Camera, Lens | None]:
    """Read the camera of the rendered region as evaluated now, and its lens."""
    render = depsgraph.scene.render
    region = render_region(render)
    camera = engine.camera_override or depsgraph.scene.camera
    evaluated = camera and camera.evaluated_get(depsgraph)
    eye = None
    if evaluated is not None and is_stereo:
        matrix_world = np.array(engine.camera_model_matrix(evaluated)).reshape(4, 4)
        eye = Eye(matrix_world, engine.camera_shift_x(evaluated))
    whole = read_camera(evaluated, render, eye)
    return whole.cropped(region.x0_px, region.y0_px, region.size_px), read_lens(evaluated)


def _read_hands(
    depsgraph: bpy.types.Depsgraph,
    hands: Sequence[_Pair],
    lights: Mapping[str, Light],
    camera: Camera,
) -> tuple[HandTask, ...]:
    return tuple(
        HandTask(
            hand.renderer,
            read_shot(visible, depsgraph, camera, len(hand.renderer.hand.v_template), lights.get(hand.name)),
        )
        for hand, visible in hands
    )


def read_exposure(scene: bpy.types.Scene, lens: Lens | None) -> tuple[ExposureSample, ...]:
    """Read the exposure samples of a frame, the one nearest to the frame itself first."""
    return exposure_samples(scene.livehand.blur_samples, _read_shutter(scene.render), lens)


def read_lens(camera: bpy.types.Object) -> Lens | None:
    """Read the lens of an evaluated camera; None if its depth of field is off."""
    settings = camera.data.dof
    if not settings.use_dof:
        return None
    radius_m = camera.data.lens * 1e-3 / (2 * settings.aperture_fstop)
    return Lens(radius_m, max(_focus_m(camera, settings), camera.data.clip_start))


def _read_shutter(render: bpy.types.RenderSettings) -> Shutter | None:
    if not render.use_motion_blur:
        return None
    length = render.motion_blur_shutter
    return Shutter({"START": 0.0, "CENTER": -length / 2, "END": -length}[render.motion_blur_position], length)


def _focus_m(camera: bpy.types.Object, settings: bpy.types.CameraDOFSettings) -> float:
    """Compute the depth of the plane of focus along the camera's axis, as Blender does."""
    target = settings.focus_object
    if target is None:
        return settings.focus_distance
    focus = target.matrix_world
    if settings.focus_subtarget and target.type == "ARMATURE":
        bone = target.pose.bones.get(settings.focus_subtarget)
        focus = focus @ bone.matrix if bone else focus
    matrix = np.array(camera.matrix_world)
    axis = -matrix[:3, 2] / np.linalg.norm(matrix[:3, 2])
    return float(abs(axis @ (np.array(focus)[:3, 3] - matrix[:3, 3])))
