"""A scene for a filmed take: the camera that filmed it, with the movie behind it, and hands of the sides it shows."""

from __future__ import annotations

from math import pi
from pathlib import Path

import bpy

from ...backend.hand.model_file import load_default_hand
from ...backend.motion.landmarks.take_fit import FilmCamera
from ...backend.records.side import Side
from ..rig.build import add_hand
from ..rig.hand import RiggedHand, active_hand

_DISPLAY_M = 0.1


def hand_of_side(context: bpy.types.Context, side: Side) -> RiggedHand | None:
    """Find the active hand if it is of the side, else the scene's first of it; None if there is none."""
    active = active_hand(context)
    hands = [RiggedHand.of(active)] if active is not None else []
    return next((hand for hand in [*hands, *RiggedHand.all_in(context.scene)] if hand.side == side), None)


def new_hand(context: bpy.types.Context, side: Side) -> RiggedHand:
    """Add a hand of the built-in model at the world's origin."""
    return RiggedHand.of(add_hand(context, load_default_hand().for_side(side), "", f"{side.title()} Hand"))


def film_camera(scene: bpy.types.Scene, film: FilmCamera, path: Path, start_frame: int) -> bpy.types.Object:
    """Return the scene's camera, or a new one at the origin along +Y, with the film's lens and the movie behind.

    Args:
        scene: gets the camera.
        film: the film's own.
        path: of the movie.
        start_frame: at which the movie starts.
    """
    camera = camera_with_lens(scene, film)
    clip = bpy.data.movieclips.load(str(path), check_existing=True)
    clip.frame_start = start_frame
    backgrounds = camera.data.background_images
    shown = (one for one in backgrounds if one.source == "MOVIE_CLIP" and one.clip == clip)
    background = next(shown, None) or backgrounds.new()
    background.source, background.clip, background.alpha = "MOVIE_CLIP", clip, 1.0
    background.frame_method = "FIT"
    camera.data.show_background_images = True
    return camera


def camera_with_lens(scene: bpy.types.Scene, film: FilmCamera) -> bpy.types.Object:
    """Return the scene's camera, or a new one at the origin that looks along +Y, with the film's lens."""
    camera = scene.camera
    if camera is None:
        camera = bpy.data.objects.new("LiveHand Camera", bpy.data.cameras.new("LiveHand Camera"))
        camera.rotation_euler = (pi / 2, 0, 0)
        camera.data.display_size = _DISPLAY_M
        scene.collection.objects.link(camera)
        scene.camera = camera
    lens = camera.data
    lens.type, lens.sensor_fit, lens.shift_x, lens.shift_y = "PERSP", "HORIZONTAL", 0.0, 0.0
    lens.lens = film.focal_px / film.size_px[0] * lens.sensor_width
    return camera


def match_film(scene: bpy.types.Scene, film: FilmCamera, fps: float, start_frame: int, count: int) -> None:
    """Give the scene the film's size, rate and length, so that a frame of the one is a frame of the other."""
    render = scene.render
    render.resolution_x, render.resolution_y = film.size_px
    render.pixel_aspect_x = render.pixel_aspect_y = 1
    render.fps = max(1, round(fps))
    render.fps_base = render.fps / fps
    scene.frame_start, scene.frame_end = start_frame, start_frame + max(count, 1) - 1
