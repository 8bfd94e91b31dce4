"""Shared parts of the stories in Blender's window: running them, screenshots, and reports.

A story is a generator. Each `yield` returns to Blender's event loop: with a number, for as many seconds; with a
function, until it returns true.
"""

import faulthandler
import importlib
import json
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np

OUT = Path(sys.argv[sys.argv.index("--") + 1])
PACKAGE = "bl_ext.user_default.livehand"
TICK_S = 0.005
PATIENCE_S = 600  # the first picture compiles kernels, on a machine that may be busy


class Report:
    def __init__(self):
        self.figures, self.failures = {}, []

    def check(self, holds, words):
        if not holds:
            self.failures.append(words)

    def write(self):
        (OUT / "report.json").write_text(json.dumps({"figures": self.figures, "failures": self.failures}))


def view_area():
    return next(area for area in bpy.context.window_manager.windows[0].screen.areas if area.type == "VIEW_3D")


def in_view(kind="WINDOW"):
    """Context for operators that need the 3D view, or another of its regions."""
    area = view_area()
    window = bpy.context.window_manager.windows[0]
    region = next(region for region in area.regions if region.type == kind)
    return bpy.context.temp_override(window=window, area=area, region=region)


def screenshot(name):
    """[H, W, 3] in 0..1, top row first, of the whole window."""
    path = OUT / f"{name}.png"
    subprocess.run(["import", "-window", "root", str(path)], check=True)
    image = bpy.data.images.load(str(path))
    pixels = np.empty(len(image.pixels), np.float32)
    image.pixels.foreach_get(pixels)
    width, height = image.size
    bpy.data.images.remove(image)
    return pixels.reshape(height, width, -1)[::-1, :, :3]


def picture(name, part, width=None):
    """A part of the window (WxH+X+Y, px from the upper left) as a small picture for the documentation."""
    look = ["import", "-window", "root", "-crop", part, "+repage", "-strip"]
    resize = ["-resize", f"{width}x"] if width else []
    subprocess.run([*look, *resize, "+dither", "-colors", "200", f"PNG8:{OUT / name}.png"], check=True)


def module(name):
    """One of LiveHand's modules, from the installed extension."""
    return importlib.import_module(f"{PACKAGE}.{name}")


def watch_images():
    """The moments when images of hands reach the view, a list that grows."""
    viewport, shown = module("livehand_blender.render.viewport"), []

    class WatchedTexture(viewport.ImageTexture):
        def upload(self, until_s):
            is_whole = super().upload(until_s)
            if is_whole:
                shown.append(time.perf_counter())
            return is_whole

    viewport.ImageTexture = WatchedTexture
    return shown


def view_of(shot):
    """The part of a screenshot that the 3D view's region covers, without its toolbars."""
    region = next(region for region in view_area().regions if region.type == "WINDOW")
    bottom = shot.shape[0] - region.y
    return shot[bottom - region.height + 60 : bottom, region.x + 60 : region.x + region.width]


def skin(pixels):
    """Which pixels have a hand's colour: the scene around it is blue and grey."""
    red, green, blue = np.moveaxis(pixels, -1, 0)
    return (red > 1.15 * green) & (green > blue) & (red > 0.25)


def run_story(steps, report, at_each_tick=lambda: None, has_splash=False):
    """Resume the story whenever its condition is met; quit Blender at its end."""
    bpy.context.preferences.view.show_splash = has_splash
    bpy.context.preferences.view.show_tooltips = False  # they would cover what the pictures show
    bpy.context.preferences.use_preferences_save = False
    state = {"condition": 2, "since": time.perf_counter()}

    def is_met(condition):
        return condition() if callable(condition) else time.perf_counter() >= state["since"] + condition

    def tick():
        at_each_tick()
        try:
            if is_met(state["condition"]):
                state["condition"], state["since"] = next(steps), time.perf_counter()
            elif time.perf_counter() > state["since"] + PATIENCE_S:
                faulthandler.dump_traceback()
                raise TimeoutError("a condition of the story was not met in time")
        except StopIteration:
            return finish()
        except Exception:
            traceback.print_exc()
            report.failures.append(traceback.format_exc(limit=-2))
            screenshot("failed")
            return finish()
        return TICK_S

    def finish():
        report.write()
        bpy.ops.wm.quit_blender()

    bpy.app.timers.register(tick, first_interval=1)
