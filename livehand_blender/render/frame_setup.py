"""The hands of a frame: who they are, and the work that their picture takes, read from the depsgraph."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import bpy

from ...backend.avatars.session import Device, Session
from ...backend.hand.model import HandModel
from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.rendering.frame_task import FrameTask, HandRenderer, HandTask
from ..rig.hand import find_hands, mesh_of
from ..scene.exposure import SHARP, ExposureSample, Lens, exposure_samples, seen_at
from ..scene.grade import Grade
from ..scene.shot import HandSource, hand_source, read_shot, visible_hands

ReadCamera = Callable[[], tuple[Camera, Lens | None]]
SetFrame = Callable[[int, float], None]


@dataclass(frozen=True)
class HandInstance:
    """One hand that a frame shows.

    Attributes:
        name: of its armature.
        mesh_name: of the object that is seen, as Cryptomatte names it.
        source: its files.
        model: of the hand.
        renderer: of its avatar.
        grade: what becomes of its colours.
    """

    name: str
    mesh_name: str
    source: HandSource
    model: HandModel
    renderer: HandRenderer
    grade: Grade


@dataclass(frozen=True)
class FrameSetup:
    """The hands of a frame, in one order, and their work: every moment's tasks are in that order."""

    actors: tuple[HandInstance, ...]
    task: FrameTask


def read_frame_setup(
    depsgraph: bpy.types.Depsgraph, session: Session, read_camera: ReadCamera, set_frame: SetFrame
) -> FrameSetup:
    """The frame as the depsgraph stands, and, where it is blurred, a little before and after.

    Args:
        depsgraph: of the frame; at its end it stands where it stood.
        session: loads what is not loaded.
        read_camera: the view and its lens as the depsgraph stands.
        set_frame: evaluates the depsgraph at a frame and a part of one.

    Raises:
        LiveHandError: the scene has no hand, or a hand, an avatar or the camera is at fault.
    """
    scene = depsgraph.scene
    if not find_hands(scene):
        raise LiveHandError(
            "a render needs a LiveHand hand, the scene has none; add one (Add > Armature > LiveHand Hand)"
        )
    hands = visible_hands(depsgraph)
    actors = tuple(_actor(hand, session, _device(scene)) for hand in hands)
    camera, lens = read_camera()
    moments = exposure_samples(scene, lens) if actors else ()
    if moments == (SHARP,):
        return FrameSetup(actors, FrameTask((_tasks(depsgraph, actors, camera),)))
    return FrameSetup(
        actors, FrameTask(tuple(_through_the_shutter(depsgraph, actors, moments, read_camera, set_frame)))
    )


def _through_the_shutter(
    depsgraph: bpy.types.Depsgraph,
    actors: Sequence[HandInstance],
    moments: Sequence[ExposureSample],
    read_camera: ReadCamera,
    set_frame: SetFrame,
) -> Iterator[tuple[HandTask, ...]]:
    now = depsgraph.scene.frame_current
    stands_at = 0.0
    try:
        for moment in moments:
            if moment.offset_frames != stands_at:
                set_frame(*_split(now, moment.offset_frames))
                stands_at = moment.offset_frames
            camera, lens = read_camera()
            yield _tasks(depsgraph, actors, seen_at(camera, lens, moment))
    finally:
        if stands_at != 0.0:
            set_frame(now, 0.0)


def _split(frame: int, offset: float) -> tuple[int, float]:
    """Whole frame, and the part of one after it."""
    whole = int(offset // 1)
    return frame + whole, offset - whole


def _tasks(depsgraph: bpy.types.Depsgraph, actors: Sequence[HandInstance], camera: Camera) -> tuple[HandTask, ...]:
    evaluated = (depsgraph.scene.objects[actor.name].evaluated_get(depsgraph) for actor in actors)
    return tuple(
        HandTask(actor.renderer, read_shot(hand, depsgraph, camera, len(actor.model.v_template)))
        for actor, hand in zip(actors, evaluated, strict=True)
    )


def _actor(hand: bpy.types.Object, session: Session, device: Device) -> HandInstance:
    source = hand_source(hand)
    model = session.hand(source.model_path)
    renderer = session.renderer(source.avatar_path, model, device)
    return HandInstance(hand.name, mesh_of(hand.original).name, source, model, renderer, Grade.of_hand(hand))


def _device(scene: bpy.types.Scene) -> Device:
    return Device(scene.livehand.device, scene.livehand.precision)
