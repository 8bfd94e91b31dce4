"""The first hour: a camera, Rendered shading, a still and the film."""

import itertools
import subprocess
import time

import bpy
import numpy as np
from hour_hands import frame_both
from hour_motion import area_with, geometry_of
from hour_posing import select
from stage import OUT, picture, screenshot, skin, view_area, view_of, watch_images
from user import choose, find_button, over_view, press, press_button, region_of

FILM_FRAMES = 48
MIN_COVERAGE = 0.03  # of each half of a frame by a hand
PANEL_PX, TABS_PX = (44, 122), 34  # of the panel Render: above and below its first button; right of it


def aim_the_camera(report):
    """Add a camera, and align it to the view."""
    scene = bpy.context.scene
    yield from over_view()
    view = view_area().spaces.active.region_3d
    yield from press("KP_5")
    report.check(view.view_perspective == "PERSP", f"Numpad 5 gives {view.view_perspective}")
    yield from select("left")
    yield from frame_both()
    yield from press("KP_Subtract", times=5)
    yield from choose("shift+a", "camera")
    report.check(scene.camera is not None, "the added camera is not the scene's")
    yield from over_view()
    yield from press("ctrl+alt+KP_0")
    yield 1
    picture("13_camera", "1056x692+0+28")
    report.check(view_area().spaces.active.region_3d.view_perspective == "CAMERA", "the view is not the camera's")


def see_it_rendered(report):
    """*Render with LiveHand* in the tab, then Rendered shading."""
    scene = bpy.context.scene
    _, y = yield from find_button("livehand.set_engine")
    left, _, width, _ = region_of("UI")
    picture("14_render_panel", f"{width - TABS_PX}x{sum(PANEL_PX)}+{left}+{y - PANEL_PX[0]}")
    yield from press_button("livehand.set_engine")
    report.check(scene.render.engine == "LIVEHAND", "Render with LiveHand was not pressed")
    lights = [thing for thing in scene.objects if thing.type == "LIGHT"]
    report.check(len(lights) == 3, f"the first hand did not bring Studio Lights: {len(lights)} lights")
    scene.render.resolution_percentage = 50
    scene.frame_end = FILM_FRAMES
    scene.frame_set(30)
    yield from over_view()
    yield from press("n")
    shown = watch_images()
    yield from press("z")
    yield from press("8")
    shading = view_area().spaces.active.shading
    report.check(shading.type == "RENDERED", f"the shading is {shading.type}")
    yield from over_view()
    yield from press("alt+shift+z")
    began = time.perf_counter()
    yield lambda: shown  # until then Cycles shows the meshes
    report.figures["both_hands_in_rendered_shading_s"] = round(time.perf_counter() - began)
    yield 15  # until it is refined
    is_there = both_halves(skin(camera_frame_of(screenshot("rendered"))))
    report.check(is_there, "both hands are not visible in Rendered shading")
    picture("15_rendered", "1056x692+0+28")


def camera_frame_of(shot):
    """Approximately the camera's frame: the middle of the view, half as wide."""
    view = view_of(shot)
    height, width = view.shape[:2]
    return view[height // 4 : 3 * height // 4, width // 4 : 3 * width // 4]


def render_the_still(report):
    """F12 from solid shading, so that the view does not render at the same time."""
    done = []
    bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
    view_area().spaces.active.shading.type = "SOLID"
    yield from over_view()
    yield from press("F12")
    yield lambda: done
    yield 3
    picture("16_still", geometry_of(area_with("IMAGE_EDITOR")), width=1056)
    path = OUT / "still.png"
    bpy.data.images["Render Result"].save_render(str(path))
    report.check(both_halves(alpha_of(path) > 0.5), "both hands are not visible in the still")
    yield from press("Escape")


def render_the_film(report):
    """Ctrl-F12."""
    scene, done = bpy.context.scene, []
    scene.render.filepath = str(OUT / "film" / "wave_")
    scene.render.image_settings.file_format = "PNG"
    bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
    bpy.app.handlers.render_cancel.append(lambda *_: done.append(False))
    yield from over_view()
    yield from press("ctrl+F12")
    yield lambda: len(list((OUT / "film").glob("*.png"))) > 20
    yield lambda: len(list((OUT / "film").glob("*.png"))) > 40
    yield lambda: done
    files = sorted((OUT / "film").glob("*.png"))
    report.check(len(files) == FILM_FRAMES, f"{len(files)} frames of {FILM_FRAMES}")
    alphas = [alpha_of(file) for file in files]
    report.check(all(both_halves(alpha > 0.5) for alpha in alphas), "a frame without one of the hands")
    changes = [np.abs(one - other) for one, other in itertools.pairwise(alphas)]
    moved = [[np.mean([half.mean() > 1e-4 for half in np.array_split(change, 2, 1)]) for change in changes]]
    report.check(np.mean(moved) > 0.9, "a hand stands still in the film")
    shown = [str(files[index]) for index in range(3, FILM_FRAMES - 8, 8)]
    row = [*shown, "-gravity", "center", "-crop", "600x540+0+0", "+repage", "+append"]
    look = ["-background", "#303030", "-flatten", "-resize", "1100x", "-quality", "88"]
    subprocess.run(["convert", *row, *look, str(OUT / "17_film.jpg")], check=True)


def both_halves(mask):
    return all(half.mean() > MIN_COVERAGE for half in np.array_split(mask, 2, axis=1))


def alpha_of(path):
    """[H, W]"""
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, 4)[..., 3]
