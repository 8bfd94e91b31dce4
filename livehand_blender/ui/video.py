"""Import of videos: hands are tracked, fitted and keyed, and the movie stands behind them."""

from __future__ import annotations

from pathlib import Path

import bpy
import numpy as np
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty
from bpy_extras.io_utils import ImportHelper

from ...backend.motion.landmarks.take_file import take_doubts
from ...backend.records.side import SIDES, Side
from ...backend.tracking.film_job import FilmRequest
from ...backend.tracking.weights import has_networks
from ..motion.film_job import FilmJob
from ..motion.film_scene import film_camera, hand_of_side, match_film, new_hand
from ..motion.filmed import key_take
from ..motion.keying import Placement
from ..rig.hand import RiggedHand
from ..rig.sliders import read_beta
from .jobs import RunsJob
from .live import draw_live
from .mixins import HandTab, NeedsTracker
from .packages import draw_tracker

_PATTERN = "*.mp4;*.mov;*.m4v;*.mkv;*.webm;*.avi;*.mts"


class LIVEHAND_OT_import_video(NeedsTracker, RunsJob, bpy.types.Operator, ImportHelper):
    """Key hands with those in a video: the active hand, others of the scene, or new ones."""

    bl_idname = "livehand.import_video"
    bl_label = "Import Hand Video"
    bl_options = {"UNDO"}  # to adjust it afterwards would be to track again

    filename_ext = ".mp4"
    filter_glob: StringProperty(default=_PATTERN, options={"HIDDEN"})
    focal_mm: FloatProperty(
        name="Focal Length",
        subtype="DISTANCE_CAMERA",
        description="Of the filming camera for a film 36 mm wide; 0: guessed, which is wrong in the distance only",
        min=0,
        soft_max=120,
    )
    start_frame: IntProperty(name="Start Frame", description="Frame at which the movie starts", default=1)
    is_picture_mirrored: BoolProperty(name="Mirrored Picture", description="The video was mirrored, as selfies are")
    match_scene: BoolProperty(
        name="Match Scene to Video",
        description="Give the scene the video's size, frame rate and length; off: the motion is resampled",
        default=True,
    )

    def start(self, context: bpy.types.Context) -> FilmJob:
        """Track and fit everything first, so that an error changes nothing."""
        hands: dict[Side, RiggedHand] = {
            side: hand for side in SIDES if (hand := hand_of_side(context, side)) is not None
        }
        return FilmJob(
            FilmRequest(
                source=str(Path(bpy.path.abspath(self.filepath))),
                output="",
                focal_mm=self.focal_mm,
                is_picture_mirrored=self.is_picture_mirrored,
                models={side: str(hand.model_path or "") for side, hand in hands.items()},
                betas={side: read_beta(hand.armature).tolist() for side, hand in hands.items()},
            )
        )

    def take(self, context: bpy.types.Context, job: FilmJob) -> None:
        """Key the hands, and let the movie stand behind them."""
        film, path = job.fits(), Path(bpy.path.abspath(self.filepath))
        if self.match_scene:
            match_film(context.scene, film.camera, film.fps, self.start_frame, film.count)
        camera = film_camera(context.scene, film.camera, path, self.start_frame)
        context.view_layer.update()
        placement = Placement("opencv", self.start_frame, camera=np.array(camera.matrix_world.normalized()))
        for side, fit in film.fits.items():
            hand = hand_of_side(context, side) or new_hand(context, side)
            count = key_take(context.scene, hand, fit, placement)
            self.report({"INFO"}, f"Keyed {count} frames of the {side} hand")
            if warning := take_doubts(fit, hand.model):
                self.report({"WARNING"}, f"Check the {side} hand: {warning}")


class LIVEHAND_PT_video(HandTab, bpy.types.Panel):
    """Hands from videos."""

    bl_label = "Video"

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
