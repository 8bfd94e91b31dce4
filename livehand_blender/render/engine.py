"""Render engine LIVEHAND: a switchboard between Blender's render pipeline and the backend.

In a scene, Cycles renders all but the hands, which still cast their shadows, and the hands are put in by depth; alone,
Cycles is not asked. In 3D views Cycles draws the scene, and the hands are drawn over it.

Blender goes on as if nothing had happened after an exception in `render`, and saves a black frame; only
`report({'ERROR'})` stops a still and an animation. So every failure ends there.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Iterator
from functools import partial
from typing import ClassVar

import bpy
import numpy as np

from ...backend.avatars.session import Session
from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.rendering.cryptomatte import crypto_metadata
from ...backend.rendering.frame_queue import FrameQueue
from ...backend.rendering.frame_task import ExposureFrames, FrameTask
from ..scene.camera import Eye, read_camera, render_region
from ..scene.exposure import Lens, read_lens
from ..scene.look import in_scene_colours
from ..scene.proxy import hidden_from_camera, hide_from_camera
from ..scene.settings import ENGINE
from .cycles_engine import CyclesEngine
from .cycles_scene import is_in_scene, read_scene, scene_layer
from .frame_setup import FrameSetup, read_frame_setup
from .layer import Output, Pending
from .panels import LIVEHAND_PT_passes
from .panels import register_panels as register_panels
from .panels import unregister_panels as unregister_panels
from .passes import CRYPTOMATTE, SURFACE_PASSES, ScenePasses, cryptomatte_passes, drawn_passes, fill_pass, wanted_passes
from .picture import Picture, draw_picture
from .renderer_loading import load_renderer_in_blender
from .viewport.studio import ViewportShared
from .viewport.viewport import viewport_of

LOGGER = logging.getLogger(__name__)


class LiveHandRender(CyclesEngine):
    """Renders LiveHand hands, alone on transparent ground or in their scene."""

    bl_idname = ENGINE
    bl_label = "LiveHand"
    bl_use_preview = False
    bl_use_exclude_layers = True

    # Blender makes a new engine for every render: what must outlive a frame belongs to the registered class.
    hands_session: ClassVar[Session | None] = None

    @classmethod
    def register(cls):
        """Called by Blender with the class."""
        cls.hands_session = Session(load_renderer_in_blender)
        cls.studio = ViewportShared(cls.hands_session)

    @classmethod
    def unregister(cls):
        """Called by Blender with the class: give the avatars' memory back."""
        cls.studio.close()
        if cls.hands_session:
            cls.hands_session.free()
        cls.hands_session = None

    @classmethod
    def required_session(cls) -> Session:
        """The session.

        Raises:
            LiveHandError: the class is not registered.
        """
        if cls.hands_session is None:
            raise LiveHandError("the LiveHand add-on is not enabled; enable it in the preferences")
        return cls.hands_session

    def view_update(self, context, depsgraph):
        """The scene of a 3D view in Rendered shading has changed."""
        with contextlib.ExitStack() as hidden:
            with contextlib.suppress(LiveHandError):  # a hand without a mesh: the view says so
                hidden.enter_context(hidden_from_camera(depsgraph))
            super().view_update(context, depsgraph)
        viewport_of(self).update(context, depsgraph)

    def view_draw(self, context, depsgraph):
        """Draw a 3D view: the scene as Cycles has it, the hand over it."""
        super().view_draw(context, depsgraph)
        viewport_of(self).draw(self, context, depsgraph)

    def update_render_passes(self, scene, renderlayer):
        """Tell Blender's compositor which sockets a view layer has."""
        if is_in_scene(scene):
            super().update_render_passes(scene, renderlayer)
        for one in wanted_passes(renderlayer):
            self.register_pass(scene, renderlayer, one.name, len(one.channels), one.channels, one.kind)
        for name in cryptomatte_passes(renderlayer):
            self.register_pass(scene, renderlayer, name, 4, "RGBA", "COLOR")

    def update(self, data, depsgraph):
        """Before a view layer's render: Cycles' own preparations, where it is to render."""
        if is_in_scene(depsgraph.scene):
            super().update(data, depsgraph)

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

    def render_frame_finish(self):
        """After a frame's last view layer."""
        if self.session is not None:
            super().render_frame_finish()

    def _render(self, depsgraph: bpy.types.Depsgraph) -> None:
        output = Output.of(depsgraph)
        pending = [self._begin(depsgraph, view) for view in self._views(depsgraph.scene.render)]
        queue = self.required_session().queue
        if queue is not None and queue.prefetchable_frame is not None:
            self._prefetch(depsgraph, queue, queue.prefetchable_frame)
        if output.is_in_scene:
            hide_from_camera(depsgraph)
            self.add_pass("Depth", 1, "Z", layer=output.layer)  # Cycles fills it, asked for by the layer or not
            super().render(depsgraph)  # which frees the depsgraph: nothing may be read from it any more
        self.update_stats("", "LiveHand | rendering the hand")
        for one in pending:
            moments = None if self.test_break() else one.wait()
            if moments is None:
                return
            self._finish(output, one, moments)
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

    def _begin(self, depsgraph: bpy.types.Depsgraph, view: str) -> Pending:
        """The frame's task, handed to the queue if there is one."""
        stage = self._stage(depsgraph, is_stereo=bool(view))
        queue = self.required_session().queue
        if queue is None:
            return Pending(view, stage, partial(self._run, stage.task))
        return Pending(view, stage, queue.ask(stage.task).result)

    def _stage(self, depsgraph: bpy.types.Depsgraph, is_stereo: bool) -> FrameSetup:
        self.update_stats("", "LiveHand | reading the hands")
        session, read_camera = self.required_session(), partial(self._camera, depsgraph, is_stereo)
        with session.rendering:  # a 3D view may be loading the same avatar
            return read_frame_setup(depsgraph, session, read_camera, self.frame_set)

    def _camera(self, depsgraph: bpy.types.Depsgraph, is_stereo: bool) -> tuple[Camera, Lens | None]:
        """The region's camera as the depsgraph stands, and its lens."""
        region = render_region(depsgraph.scene.render)
        camera = self.camera_override or depsgraph.scene.camera
        evaluated = camera and camera.evaluated_get(depsgraph)
        eye = None
        if evaluated is not None and is_stereo:
            matrix_world = np.array(self.camera_model_matrix(evaluated)).reshape(4, 4)
            eye = Eye(matrix_world, self.camera_shift_x(evaluated))
        whole = read_camera(evaluated, depsgraph.scene.render, eye)
        return whole.cropped(region.x0_px, region.y0_px, region.size_px), read_lens(evaluated)

    def _run(self, task: FrameTask) -> tuple[ExposureFrames, ...] | None:
        """The task's frames; None where the user has stopped the render."""
        from ...backend.rendering.renderer import (
            RenderStopped,  # brings torch with it, which a renderer has loaded already
        )

        try:
            with self.required_session().rendering:
                return task.run(self.test_break)
        except RenderStopped:
            return None

    def _prefetch(self, depsgraph: bpy.types.Depsgraph, queue: FrameQueue, frame: int) -> None:
        """Queue a later frame's task. It is read from this very depsgraph, which is then set back."""
        now = depsgraph.scene.frame_current
        try:
            self.frame_set(frame, 0.0)
            with contextlib.suppress(LiveHandError):  # what is wrong there stops that frame when its turn has come
                queue.prefetch(self._stage(depsgraph, is_stereo=False).task)
        finally:
            self.frame_set(now, 0.0)

    def _finish(self, output: Output, pending: Pending, moments: tuple[ExposureFrames, ...]) -> None:
        """Compose a view's picture and hand it to Blender."""
        scene, around = {}, None
        if output.is_in_scene:
            scene = read_scene(self.get_result(), output.layer, pending.view, output.size_px)
            around = scene_layer(scene)
        needs_surface = any(one.name in SURFACE_PASSES for one in output.passes)
        convert = partial(in_scene_colours, scene=output.scene)
        picture = draw_picture(pending.stage, moments, output.size_px, convert, around, needs_surface)
        for one in output.passes:
            if not one.is_blenders:
                self.add_pass(one.name, len(one.channels), one.channels, layer=output.layer)
        for name in output.cryptomatte:
            self.add_pass(name, 4, "RGBA", layer=output.layer)
        self._write(output, pending.view, picture, scene)

    def _write(self, output: Output, view: str, picture: Picture, scene: ScenePasses) -> None:
        """Hand a picture to Blender; a result that is begun must be ended, or Blender crashes when it saves."""
        result = self.begin_result(0, 0, *output.size_px, layer=output.layer, view=view)
        try:
            passes = result.layers[0].passes
            for name, values in drawn_passes(picture, passes.keys(), scene):
                fill_pass(passes[name], values)
            if output.cryptomatte and not output.is_in_scene:  # else Cycles has named all objects
                for field, value in crypto_metadata(f"{output.layer}.{CRYPTOMATTE}", picture.coverage).items():
                    self.get_result().stamp_data_add_field(field, value)
        finally:
            self.end_result(result)


CLASSES = (LiveHandRender, LIVEHAND_PT_passes)
