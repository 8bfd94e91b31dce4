"""Render engine LIVEHAND: a switchboard between Blender's render pipeline and the backend.

Blender goes on as if nothing had happened after an exception in `render`, and saves a black frame; only
`report({'ERROR'})` stops a still and an animation. So every failure ends there.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator
from typing import ClassVar

import bpy
import numpy as np

from ...backend.camera import Camera
from ...backend.errors import LiveHandError
from ...backend.shot import Frame, empty_frame
from ..rig.hand import find_hands
from ..scene.camera import Eye, Region, read_camera, render_region
from ..scene.colour import combined_buffer, depth_buffer
from ..scene.settings import ENGINE
from ..scene.shot import find_hand, hand_source, read_shot, visible_hands
from ..viewport.proxy import hidden_from_camera
from ..viewport.studio import Studio
from ..viewport.viewport import viewport_of
from .cycles_engine import CyclesEngine
from .frame_queue import FrameQueue
from .panels import LIVEHAND_PT_passes
from .panels import register_panels as register_panels
from .panels import unregister_panels as unregister_panels
from .session import Device, Session
from .task import Task

LOGGER = logging.getLogger(__name__)


class LiveHandRender(CyclesEngine):
    """Renders the LiveHand hand alone, on transparent ground."""

    bl_idname = ENGINE
    bl_label = "LiveHand"
    bl_use_preview = False

    # Blender makes a new engine for every render: what must outlive a frame belongs to the registered class.
    session: ClassVar[Session | None] = None

    @classmethod
    def register(cls):
        """Called by Blender with the class."""
        cls.session = Session()
        cls.studio = Studio(cls.session)

    @classmethod
    def unregister(cls):
        """Called by Blender with the class: give the avatars' memory back."""
        cls.studio.close()
        if cls.session:
            cls.session.free()
        cls.session = None

    @classmethod
    def required_session(cls) -> Session:
        """The session.

        Raises:
            LiveHandError: the class is not registered.
        """
        if cls.session is None:
            raise LiveHandError("the LiveHand add-on is not enabled; enable it in the preferences")
        return cls.session

    def update(self, data, depsgraph):
        """A final render needs nothing of Cycles."""

    def view_update(self, context, depsgraph):
        """The scene of a 3D view in Rendered shading has changed."""
        with hidden_from_camera(depsgraph):
            super().view_update(context, depsgraph)
        viewport_of(self).update(context, depsgraph)

    def view_draw(self, context, depsgraph):
        """Draw a 3D view: the scene as Cycles has it, the hand over it."""
        super().view_draw(context, depsgraph)
        viewport_of(self).draw(self, context, depsgraph)

    def update_render_passes(self, scene, renderlayer):
        """Tell Blender's compositor which sockets a view layer has."""
        self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
        if renderlayer.use_pass_z:
            self.register_pass(scene, renderlayer, "Depth", 1, "Z", "VALUE")

    def render(self, depsgraph):
        """One frame of one view layer."""
        try:
            self._render(depsgraph)
        except LiveHandError as error:
            self.report({"ERROR"}, f"LiveHand: {error}")
        except KeyboardInterrupt:
            self.report({"ERROR"}, "LiveHand was interrupted")
        except BaseException as error:
            LOGGER.exception("The render failed")
            self.report({"ERROR"}, f"LiveHand stopped on an unexpected {type(error).__name__}: {error}")

    def _render(self, depsgraph: bpy.types.Depsgraph) -> None:
        render = depsgraph.scene.render
        region = render_region(render)
        for view in self._views(render):
            frame = self._frame(depsgraph, region, stereo=bool(view))
            if frame is None:
                return
            self._write(frame, region, depsgraph.view_layer.name, view)
        self.update_progress(1.0)

    def _views(self, render: bpy.types.RenderSettings) -> Iterator[str]:
        """Each stereo view's name, made active; without stereo one empty name."""
        if not render.use_multiview:
            yield ""
            return
        for view in render.views:
            if view.use:
                self.active_view_set(view.name)
                yield view.name

    def _camera(self, depsgraph: bpy.types.Depsgraph, stereo: bool) -> Camera:
        camera = self.camera_override or depsgraph.scene.camera
        if camera is None or not stereo:
            return read_camera(camera and camera.evaluated_get(depsgraph), depsgraph.scene.render)
        evaluated = camera.evaluated_get(depsgraph)
        matrix_world = np.array(self.camera_model_matrix(evaluated)).reshape(4, 4)
        eye = Eye(matrix_world, self.camera_shift_x(evaluated))
        return read_camera(evaluated, depsgraph.scene.render, eye)

    def _frame(self, depsgraph: bpy.types.Depsgraph, region: Region, stereo: bool) -> Frame | None:
        """The hand as it stands, an empty frame in a view layer that shows none on purpose, or None if stopped."""
        session = self.required_session()
        with session.rendering:
            task = self._task(depsgraph, region, stereo)
            if task is None:
                return empty_frame(region.size_px)
            queue = session.queue
            if queue is None:
                return _run(task, self.test_break)
        result = queue.ask(task)
        if queue.foreseen_frame is not None:
            self._foresee(depsgraph, queue, queue.foreseen_frame)
        try:
            return result.result()
        finally:
            del result  # an error's traceback holds this frame: together they would keep Blender's objects alive

    def _foresee(self, depsgraph: bpy.types.Depsgraph, queue: FrameQueue, frame: int) -> None:
        """Queue a later frame's task. It is read from this very depsgraph, which is then set back."""
        now = depsgraph.scene.frame_current
        try:
            self.frame_set(frame, 0.0)
            with contextlib.suppress(LiveHandError):  # what is wrong there stops that frame when its turn has come
                task = self._task(depsgraph, render_region(depsgraph.scene.render), stereo=False)
                if task:
                    queue.foresee(task)
        finally:
            self.frame_set(now, 0.0)

    def _task(self, depsgraph: bpy.types.Depsgraph, region: Region, stereo: bool) -> Task | None:
        """What is to be rendered as the depsgraph stands; None in a view layer that shows no hand on purpose."""
        scene = depsgraph.scene
        camera = self._camera(depsgraph, stereo).cropped(region.x0_px, region.y0_px, region.size_px)
        is_layer_of_hand_scene = len(scene.view_layers) > 1 and find_hands(scene)
        if is_layer_of_hand_scene and not visible_hands(depsgraph):
            return None
        session = self.required_session()
        armature = find_hand(depsgraph)
        source = hand_source(armature)
        self.update_stats("", f"LiveHand | {armature.name} | loading the avatar")
        hand = session.hand(source.model_path)
        renderer = session.renderer(source.avatar_path, hand, _device(scene))
        self.update_stats("", f"LiveHand | {armature.name} | rendering")
        return Task(renderer, read_shot(armature, depsgraph, camera, len(hand.v_template)))

    def _write(self, frame: Frame, region: Region, layer: str, view: str) -> None:
        """Hand a frame to Blender; a result that is begun must be ended, or Blender crashes when it saves."""
        width, height = region.size_px
        result = self.begin_result(0, 0, width, height, layer=layer, view=view)
        try:
            passes = result.layers[0].passes
            _fill(passes["Combined"], combined_buffer(frame))
            if "Depth" in passes:
                _fill(passes["Depth"], depth_buffer(frame))
        finally:
            self.end_result(result)


def _run(task: Task, should_stop: Callable[[], bool]) -> Frame | None:
    from ...backend.renderer import RenderStopped  # brings torch with it, which a renderer has loaded already

    try:
        return task.run(should_stop)
    except RenderStopped:
        return None


def _device(scene: bpy.types.Scene) -> Device:
    return Device(scene.livehand.device, scene.livehand.precision)


def _fill(render_pass: bpy.types.RenderPass, buffer: np.ndarray) -> None:
    expected = len(render_pass.rect) * render_pass.channels
    if buffer.size != expected:
        raise RuntimeError(f"pass {render_pass.name} has {expected} numbers, the frame {buffer.size}")
    render_pass.rect.foreach_set(buffer)


CLASSES = (LiveHandRender, LIVEHAND_PT_passes)
