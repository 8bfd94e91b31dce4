"""Render engine LIVEHAND, between Blender's render pipeline and the backend.

In a scene, Cycles renders everything but the hands, which still cast shadows, and the hands are inserted by depth. With
hands only, Cycles does not render. In 3D views Cycles draws the scene, and the hands are drawn over it.

After an exception in `render`, Blender saves a black frame and continues; only `report({'ERROR'})` stops a still or an
animation. So every failure is reported there.
"""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import ClassVar, TypeVar

import bpy
import numpy as np

from ...backend.records.errors import LiveHandError
from ...backend.records.frame import Frame
from ...backend.render.background import BackgroundWork, ShouldStop
from ...backend.render.frame_queue import FrameQueue
from ...backend.render.frame_task import ExposureFrames, FrameTask
from ...backend.render.picture import Picture, compose_picture, surface_of
from ...backend.render.session import Session
from ...backend.system.memory import memory_message
from ..hands.proxy import hidden_from_camera, hide_from_camera, move_vertices, use_albedo
from ..scene.removal import settle_removals
from ..scene.settings import ENGINE
from .cycles import CyclesEngine, has_only_hands, is_in_scene, one_sample, scene_layer
from .frame_setup import FrameSetup, ViewSetup, VisibleHands, read_frame_setup, read_frame_task
from .hand_source import drawing_note, load_renderer_in_blender
from .keep_look import in_scene_colours
from .light_groups import GroupedFrames, group_passes, grouped_frames, light_groups, pass_name, task_with_groups
from .light_passes import Measurement, is_measured, with_measured_light
from .panels import LIVEHAND_PT_hand_light, LIVEHAND_PT_passes
from .panels import register_panels as register_panels
from .panels import unregister_panels as unregister_panels
from .passes import ScenePasses, cryptomatte_passes, wanted_passes
from .picture_origin import with_watermark
from .preparation import Preparation
from .render_result import read_scene, write_picture
from .viewport import viewport_of
from .viewport_shared import ViewportShared

LOGGER = logging.getLogger(__name__)

_SOON_S, _SHOWN_S = 0.1, 0.5

Result = TypeVar("Result")
ResultOfHands = Callable[[], tuple[ExposureFrames, ...] | None]
"""Waits for the hands of a view; returns None if the user has stopped the render."""


class LiveHandRender(CyclesEngine):
    """Renders LiveHand hands, alone on transparent ground or in their scene."""

    bl_idname = ENGINE
    bl_label = "LiveHand"
    bl_use_preview = False
    bl_use_exclude_layers = True

    # Blender makes an engine for every render, so what outlives a frame belongs to the registered class.
    hands_session: ClassVar[Session | None] = None

    @classmethod
    def register(cls):
        """Set up what outlives a render, when Blender registers the class."""
        cls.hands_session = Session(load_renderer_in_blender)
        # Not declared above: Blender evaluates a class's annotations, `typing` caches them for ever, and Blender as a
        # module hangs at exit if a class of a module that imports bpy is still referenced.
        cls.preparation = Preparation()
        cls.viewport_shared = ViewportShared(cls.hands_session, cls.preparation)
        cls.background = BackgroundWork()
        cls.measurement = None

    @classmethod
    def unregister(cls):
        """Free the avatars' memory, when Blender unregisters the class."""
        cls.preparation.stop()
        cls.background.close()
        cls.viewport_shared.close()
        if cls.hands_session:
            cls.hands_session.free()
        cls.hands_session = None

    @classmethod
    def required_session(cls) -> Session:
        """Return the session.

        Raises:
            LiveHandError: the class is not registered.
        """
        if cls.hands_session is None:
            raise LiveHandError("the LiveHand add-on is not enabled; enable it in the preferences")
        return cls.hands_session

    def view_update(self, context, depsgraph):
        """Update the view, when Blender reports that the scene of a 3D view in Rendered shading has changed."""
        viewport_of(self).update(context, depsgraph)
        with contextlib.ExitStack() as hidden:
            if viewport_of(self).has_image:
                with contextlib.suppress(LiveHandError):  # a hand without a mesh, which the view reports
                    hidden.enter_context(hidden_from_camera(depsgraph, viewport_of(self).hand_meshes(depsgraph)))
            hidden.enter_context(self._cycles_at_rest(depsgraph))
            super().view_update(context, depsgraph)

    def view_draw(self, context, depsgraph):
        """Draw a 3D view, when Blender asks for it: Cycles' preview, and the hands over it."""
        with self._cycles_at_rest(depsgraph):
            super().view_draw(context, depsgraph)
        viewport_of(self).draw(self, context, depsgraph)

    def _cycles_at_rest(self, depsgraph: bpy.types.Depsgraph) -> contextlib.AbstractContextManager[None]:
        """Make Cycles take one sample within, if the image of the hands is all that the view is for.

        Until it is there, compiling and rendering it needs the processor.
        """
        try:
            is_for_hands = not viewport_of(self).has_failed and has_only_hands(depsgraph)
        except LiveHandError:  # a hand without a mesh, which the view reports
            is_for_hands = False
        return one_sample(depsgraph) if is_for_hands else contextlib.nullcontext()

    def update_render_passes(self, scene, renderlayer):
        """Register the sockets that a view layer has in the compositor, when Blender asks for them."""
        if is_in_scene(scene):
            super().update_render_passes(scene, renderlayer)
        for one in wanted_passes(renderlayer):
            self.register_pass(scene, renderlayer, one.name, len(one.channels), one.channels, one.kind)
        for name in cryptomatte_passes(renderlayer):
            self.register_pass(scene, renderlayer, name, 4, "RGBA", "COLOR")
        if not is_in_scene(scene):  # else Cycles has them
            for group in light_groups(renderlayer):
                self.register_pass(scene, renderlayer, pass_name(group), 3, "RGB", "COLOR")

    def update(self, data, depsgraph):
        """Let Cycles prepare the scene, before Blender renders a view layer."""
        if is_in_scene(depsgraph.scene):
            super().update(data, depsgraph)

    def render(self, depsgraph):
        """Render one frame of one view layer, when Blender asks for it."""
        try:
            self._render(depsgraph)
        except LiveHandError as error:
            self.report({"ERROR"}, f"LiveHand: {error}")
        except KeyboardInterrupt:
            self.report({"ERROR"}, "LiveHand was interrupted")
        except BaseException as error:
            if message := memory_message(error):
                self.report({"ERROR"}, f"LiveHand: {message}")
                return
            LOGGER.exception("The render failed")
            self.report({"ERROR"}, f"LiveHand stopped on an unexpected {type(error).__name__}: {error}")

    def render_frame_finish(self):
        """Finish a frame, after Blender has rendered its last view layer."""
        if self.session is not None:
            super().render_frame_finish()

    def _render(self, depsgraph: bpy.types.Depsgraph) -> None:
        if self.measurement is not None:
            self._measure(depsgraph, self.measurement)
            return
        frame = self._read(depsgraph)
        if frame is None:
            return
        for view, frames, scene in self._render_views(depsgraph, frame):
            composed = self._in_background(lambda _, args=(frame, view, frames, scene): self._compose(*args))
            if composed is None:
                return
            write_picture(self, frame, view.name, composed[0], scene, composed[1])

    def _in_background(self, work: Callable[[ShouldStop], Result], shows_progress: bool = False) -> Result | None:
        """Return what the work returns, done in a thread of its own; None as soon as the user stops the render.

        However long a stage takes, the user is asked all the time.
        """
        on_progress = self.update_progress if shows_progress else lambda share: None
        return self.background.run(work, self.test_break, on_progress)

    def _read(self, depsgraph: bpy.types.Depsgraph) -> FrameSetup | None:
        """Read the frame's setup; None if the user has stopped the render while an avatar was loaded."""
        session = self.required_session()
        hands = VisibleHands.read(depsgraph)
        new = {source.avatar_path for source in hands.sources} - session.avatar_paths
        self.update_stats("", f"LiveHand | {drawing_note(new) or 'reading the hands'}")
        if self._in_background(lambda _: self._load(hands)) is None:
            return None
        frame = read_frame_setup(self, depsgraph, hands, session)
        if frame.is_in_scene:
            frame = with_measured_light(frame, LiveHandRender, session.rendering)
        settle_removals(depsgraph)
        return frame

    def _load(self, hands: VisibleHands) -> bool:
        """Load the hands' renderers, in any thread, so that reading the frame waits for none."""
        session = self.required_session()
        with session.rendering:  # a 3D view may be loading the same avatar
            hands.load(session)
        return True

    def _measure(self, depsgraph: bpy.types.Depsgraph, measurement: Measurement) -> None:
        """Let Cycles render the light on one hand. It frees the depsgraph."""
        layer = depsgraph.view_layer.name
        measurement.prepare(depsgraph)
        super().render(depsgraph)
        measurement.read(self.get_result(), layer)

    def _render_views(
        self, depsgraph: bpy.types.Depsgraph, frame: FrameSetup
    ) -> Iterator[tuple[ViewSetup, GroupedFrames, ScenePasses]]:
        """Yield each view with its rendered hands and Cycles' passes; ends early if the user stops the render."""
        results = self._begin_hands(depsgraph, frame)
        if frame.is_in_scene:
            self._render_scene(depsgraph, frame)
        self.update_stats("", "LiveHand | rendering the hand")
        for view, result in zip(frame.views, results, strict=True):
            samples = None if self.test_break() else result()
            if samples is None:
                return
            scene = read_scene(self.get_result(), frame.layer, view.name, frame.size_px) if frame.is_in_scene else {}
            yield view, grouped_frames(view.task, frame.light_groups, samples), scene
        self.update_progress(1.0)

    def _begin_hands(self, depsgraph: bpy.types.Depsgraph, frame: FrameSetup) -> Sequence[ResultOfHands]:
        """Submit the views' tasks to the queue, if there is one, and prefetch the next frame."""
        queue = self.required_session().queue
        tasks = [task_with_groups(view.task, frame.light_groups) for view in frame.views]
        if queue is None:
            return [partial(self._render_hands, task) for task in tasks]
        results = [queue.submit(task).result for task in tasks]
        if queue.prefetchable_frame is not None and not is_measured(frame):
            self._prefetch(depsgraph, queue, queue.prefetchable_frame)
        return results

    def _render_hands(self, task: FrameTask) -> tuple[ExposureFrames, ...] | None:
        """Render the hands; returns None if the user has stopped the render."""
        from ...backend.render.progress import RenderStopped  # torch, which a renderer has imported already

        session = self.required_session()

        def render(should_stop: ShouldStop) -> tuple[ExposureFrames, ...]:
            with session.rendering:
                return task.run(should_stop)

        try:
            return self._in_background(render, shows_progress=True)
        except RenderStopped:
            return None

    def _prefetch(self, depsgraph: bpy.types.Depsgraph, queue: FrameQueue, frame: int) -> None:
        """Queue a later frame's task. It is read from this depsgraph, which is then set back."""
        session, current_frame = self.required_session(), depsgraph.scene.frame_current
        try:
            self.frame_set(frame, 0.0)
            with contextlib.suppress(LiveHandError), session.rendering:  # an error is reported at that frame's render
                task = read_frame_task(self, depsgraph, session)
                queue.prefetch(task_with_groups(task, light_groups(depsgraph.view_layer)))
        finally:
            self.frame_set(current_frame, 0.0)

    def _render_scene(self, depsgraph: bpy.types.Depsgraph, frame: FrameSetup) -> None:
        """Let Cycles render all but the hands. It frees the depsgraph, which must not be read after this."""
        hide_from_camera(depsgraph, frame.instance_ids)
        use_albedo(depsgraph, frame.albedo)
        if not depsgraph.scene.render.use_persistent_data:  # it keeps what is evaluated, and the next frame reads that
            move_vertices(depsgraph, frame.surface_vertices)
        self.add_pass("Depth", 1, "Z", layer=frame.layer)  # needed even if the view layer does not have it on
        super().render(depsgraph)

    def _compose(
        self, frame: FrameSetup, view: ViewSetup, frames: GroupedFrames, scene: ScenePasses
    ) -> tuple[Picture, Mapping[str, np.ndarray]]:
        """Compose the picture, and its light groups' passes."""
        around = scene_layer(scene) if frame.is_in_scene else None
        surface = surface_of(frame.hands, view.task, view.motion) if frame.needs_surface else None
        convert = self._converter(frame)
        picture = compose_picture(frame.hands, frames.samples, frame.size_px, convert, around, surface)
        picture = with_watermark(picture, frame.watermark)
        return picture, group_passes(frames, frame.hands, frame.size_px, convert, scene)

    @staticmethod
    def _converter(frame: FrameSetup) -> Callable[[Frame], Frame]:
        return partial(in_scene_colours, scene=frame.scene)


def prepare_soon() -> None:
    """Compile the kernels in the background if they are not, once Blender's window is there."""
    if not bpy.app.background and not bpy.app.timers.is_registered(_prepare):
        bpy.app.timers.register(_prepare, first_interval=_SOON_S)


def prepare_now() -> None:
    """Start compiling the kernels at once: a view that begins before would compile them a second time."""
    if not bpy.app.background:
        LiveHandRender.preparation.go_on()
        prepare_soon()


def stop_preparing() -> None:
    """Undo `prepare_soon`."""
    if bpy.app.timers.is_registered(_prepare):
        bpy.app.timers.unregister(_prepare)


def _prepare() -> float | None:
    """Start, and show in 3D views how far it is, until it is done."""
    goes_on = LiveHandRender.preparation.go_on()
    for manager in bpy.data.window_managers:
        for area in (area for window in manager.windows for area in window.screen.areas if area.type == "VIEW_3D"):
            area.tag_redraw()
    return _SHOWN_S if goes_on else None


CLASSES = (LiveHandRender, LIVEHAND_PT_hand_light, LIVEHAND_PT_passes)
