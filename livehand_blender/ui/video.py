"""Import of videos: hands are tracked, fitted and keyed, and the movie stands behind them."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...backend.hand.model_file import load_default_hand
from ...backend.motion.landmarks.take_file import FilmedTake, take_doubts, unmirrored
from ...backend.motion.landmarks.take_fit import FilmCamera, TakeFit, fit_take
from ...backend.records.side import Side
from ...backend.tracking.weights import has_networks
from ..motion.film_scene import film_camera, hand_of_side, match_film, new_hand
from ..motion.filmed import key_take
from ..motion.keying import Placement
from ..motion.movie import Movie
from ..rig.sliders import read_beta
from .live import draw_live
from .mixins import HandTab, NeedsTracker, reports_errors
from .packages import draw_tracker

_FILM_MM = 36.0
_PATTERN = "*.mp4;*.mov;*.m4v;*.mkv;*.webm;*.avi;*.mts"


class LIVEHAND_OT_import_video(NeedsTracker, bpy.types.Operator, ImportHelper):
    """Key hands with those in a video: the active hand, others of the scene, or new ones."""

    bl_idname = "livehand.import_video"
    bl_label = "Import Hand Video"
    bl_options = {"REGISTER", "UNDO"}

    filename_ext = ".mp4"
    filter_glob: StringProperty(default=_PATTERN, options={"HIDDEN"})
    focal_mm: FloatProperty(
        name="Focal Length",
        description="Of the filming camera for a film 36 mm wide; 0: guessed, which is wrong in the distance only",
        min=0,
        soft_max=120,
    )
    start_frame: IntProperty(name="Start Frame", description="Frame at which the movie starts", default=1)
    is_picture_mirrored: BoolProperty(name="Mirrored Picture", description="The video was mirrored, as selfies are")
    match_scene: BoolProperty(
        name="Film's Size and Rate",
        description="Give the scene the video's size, frame rate and length; off: the motion is resampled",
        default=True,
    )

    @reports_errors
    def execute(self, context):
        """Track and fit everything first, so that an error changes nothing."""
        path = Path(bpy.path.abspath(self.filepath))
        take = self._tracked(context, path)
        fits: dict[Side, TakeFit] = {}
        for side, hand in take.hands.items():
            rigged = hand_of_side(context, side)
            model, beta = (rigged.model, read_beta(rigged.armature)) if rigged else (load_default_hand(), None)
            fits[side] = fit_take(hand, take.times, take.camera, model, side, take.fps, beta)
        if self.match_scene:
            match_film(context.scene, take.camera, take.fps, self.start_frame, len(take.times))
        camera = film_camera(context.scene, take.camera, path, self.start_frame)
        context.view_layer.update()
        placement = Placement("opencv", self.start_frame, camera=np.array(camera.matrix_world.normalized()))
        for side, fit in fits.items():
            hand = hand_of_side(context, side) or new_hand(context, side)
            count = key_take(context.scene, hand, fit, placement)
            self.report({"INFO"}, f"Keyed {count} frames of the {side} hand")
            if warning := take_doubts(fit, hand.model):
                self.report({"WARNING"}, f"Check the {side} hand: {warning}")

    def _tracked(self, context: bpy.types.Context, path: Path) -> FilmedTake:
        from ...backend.tracking.sighted_take import filmed_take, frames_of_film
        from ...backend.tracking.takes import track_frames
        from ...backend.tracking.tracker import HandTracker
        from ...backend.tracking.video import VideoFrame, open_video
        from ...backend.tracking.weights import load_networks

        tracker = HandTracker(load_networks())
        manager = context.window_manager

        def shown(frames: Iterator[VideoFrame], count: int) -> Iterator[VideoFrame]:
            manager.progress_begin(0, max(count, 1))
            for index, frame in enumerate(frames):
                manager.progress_update(index)
                yield frame

        try:
            if importlib.util.find_spec("av") is not None:
                video = open_video(path)
                fps, found = video.fps, track_frames(shown(frames_of_film(video), video.count), tracker)
            else:
                with closing(Movie(path)) as movie:
                    fps = movie.fps
                    frames = (VideoFrame(index / fps, picture) for index, picture in enumerate(movie.frames()))
                    found = track_frames(shown(frames, movie.count), tracker)
        finally:
            manager.progress_end()
        take = filmed_take(found, fps, None, path)
        if self.focal_mm:
            width = take.camera.size_px[0]
            take = replace(take, camera=FilmCamera(take.camera.size_px, self.focal_mm / _FILM_MM * width))
        return unmirrored(take) if self.is_picture_mirrored else take


class LIVEHAND_PT_video(HandTab, bpy.types.Panel):
    """Hands from videos."""

    bl_label = "Video"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        """Import and live hands, or how to fetch the tracker."""
        if has_networks():
            self.layout.operator("livehand.import_video", text="Import Video", icon="FILE_MOVIE")
            draw_live(self.layout, context)
            return
        draw_tracker(self.layout)


CLASSES = (LIVEHAND_OT_import_video, LIVEHAND_PT_video)


def add_to_menus() -> None:
    """Add entries to File > Import."""
    bpy.types.TOPBAR_MT_file_import.append(_draw_import)


def remove_from_menus() -> None:
    """Undo `add_to_menus`."""
    bpy.types.TOPBAR_MT_file_import.remove(_draw_import)


def _draw_import(menu: bpy.types.Menu, context: bpy.types.Context) -> None:
    menu.layout.operator("livehand.import_video", text="LiveHand Video (.mp4, .mov, ...)")
