"""Inside Blender, with a window: what a user does with a hand, step by step, and what is seen and measured.

Each `yield` gives Blender its event loop back: a number waits as many seconds, a function until it says true.
"""

import importlib
import json
import subprocess
import sys
import time
import traceback
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler, Quaternion

OUT = Path(sys.argv[sys.argv.index("--") + 1])
PACKAGE = "bl_ext.user_default.livehand.livehand_blender"
TICK_S = 0.005
PATIENCE_S = 90
FIRST_IMAGE_S = 0.5
LONGEST_BLOCK_S = 0.1


class Watch:
    """Pictures that reach the view, and how long Blender's event loop stood still between two ticks."""

    def __init__(self):
        self.pictures = []  # (seconds, larger side, px)
        self.gaps = []  # (seconds, length)
        self._last_tick = time.perf_counter()
        module = importlib.import_module(f"{PACKAGE}.viewport.viewport")
        texture_class = module.PictureTexture
        watch = self

        class Watched(texture_class):
            def __init__(self, picture):
                super().__init__(picture)
                watch.pictures.append((time.perf_counter(), max(picture.rgba.shape)))

        module.PictureTexture = Watched

    def tick(self):
        now = time.perf_counter()
        self.gaps.append((now, now - self._last_tick))
        self._last_tick = now

    def longest_block(self, since):
        return max(gap for when, gap in self.gaps if when - gap >= since)

    def pictures_since(self, since):
        return [(when - since, size) for when, size in self.pictures if when > since]


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


def in_view():
    """Context for operators that need the 3D view."""
    area = view_area()
    window = bpy.context.window_manager.windows[0]
    region = next(region for region in area.regions if region.type == "WINDOW")
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


def view_of(shot):
    """The part of a screenshot that the 3D view's region covers, without its toolbars."""
    region = next(region for region in view_area().regions if region.type == "WINDOW")
    bottom = shot.shape[0] - region.y
    return shot[bottom - region.height + 60 : bottom, region.x + 60 : region.x + region.width]


def skin(pixels):
    """Which pixels have a hand's colour: the scene around it is blue and grey."""
    red, green, blue = np.moveaxis(pixels, -1, 0)
    return (red > 1.15 * green) & (green > blue) & (red > 0.25)


def set_the_scene():
    """A hand before a blue wall, with two grey things; one second of motion."""
    scene = bpy.context.scene
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    bpy.ops.livehand.add_hand(side="right")
    hand = bpy.context.object
    bpy.ops.livehand.set_engine()
    add_thing("plane", (0, 0.25, 0), 2.0, (0.05, 0.1, 0.3), (1.5708, 0, 0))
    add_thing("plane", (0, 0, -0.13), 2.0, (0.3, 0.33, 0.4))
    add_thing("sphere", (0.13, 0.05, -0.08), 0.05, (0.1, 0.3, 0.6))
    add_thing("cube", (-0.15, 0.08, -0.09), 0.08, (0.5, 0.5, 0.55), (0, 0, 0.5))
    light = bpy.data.objects["Light"]
    light.data.type, light.data.energy, light.data.size = "AREA", 8, 0.5
    light.location, light.rotation_euler = (-0.6, -0.6, 0.8), (0.8, 0, -0.785)
    camera = scene.camera
    camera.location, camera.rotation_euler = (0.0, -0.75, 0.02), (1.56, 0, 0)
    camera.data.lens, camera.data.clip_start = 50, 0.01
    scene.render.resolution_x, scene.render.resolution_y = 512, 512
    scene.cycles.use_denoising = scene.cycles.use_preview_denoising = False
    scene.cycles.samples = scene.cycles.preview_samples = 16
    scene.frame_start, scene.frame_end = 1, 24
    key_motion(hand)
    return hand


def add_thing(kind, location, size, colour, rotation=(0, 0, 0)):
    selected = bpy.context.object
    if kind == "sphere":
        bpy.ops.mesh.primitive_uv_sphere_add(radius=size, location=location)
        bpy.ops.object.shade_smooth()
    else:
        getattr(bpy.ops.mesh, f"primitive_{kind}_add")(size=size, location=location, rotation=rotation)
    thing, material = bpy.context.object, bpy.data.materials.new(kind)
    material.use_nodes = True
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (*colour, 1)
    thing.data.materials.append(material)
    thing.select_set(False)
    selected.select_set(True)
    bpy.context.view_layer.objects.active = selected


def key_motion(hand):
    for frame, bend in ((1, 0.0), (13, 1.0), (24, 0.0)):
        bend_fingers(hand, bend)
        for bone in hand.pose.bones:
            bone.keyframe_insert("rotation_quaternion" if bone.rotation_mode == "QUATERNION" else "rotation_euler", frame=frame)


def bend_fingers(hand, share):
    """From straight (0) to half closed (1)."""
    for bone in hand.pose.bones:
        if bone.name[:-3] in ("index", "middle", "ring", "pinky") and bone.name[-1] in "RL":
            turn = Euler((0, 0, 0.9 * share))
            if bone.rotation_mode == "QUATERNION":
                bone.rotation_quaternion = turn.to_quaternion()
            else:
                bone.rotation_euler = turn


def story(watch, report):
    hand = set_the_scene()
    space = view_area().spaces.active
    space.region_3d.view_perspective = "CAMERA"
    space.show_region_ui = False
    yield 1
    start = time.perf_counter()
    space.shading.type = "RENDERED"
    yield lambda: watch.pictures_since(start)
    report.figures["first_ever_s"] = round(watch.pictures_since(start)[0][0], 2)
    report.figures["block_while_loading_s"] = round(watch.longest_block(start), 3)
    yield 8
    before = view_of(screenshot("viewport_camera"))
    report.figures["skin_share"] = round(float(skin(before).mean()), 4)
    report.check(skin(before).mean() > 0.02, "no hand in the camera's view")


def run(steps, watch, report):
    """Advance the story when what it waits for has come."""
    state = {"until": 0.0, "since": time.perf_counter()}

    def ready(wish):
        return wish() if callable(wish) else time.perf_counter() >= state["since"] + wish

    state["wish"] = 2

    def tick():
        watch.tick()
        try:
            if ready(state["wish"]):
                state["wish"], state["since"] = next(steps), time.perf_counter()
            elif time.perf_counter() > state["since"] + PATIENCE_S:
                raise TimeoutError("what the story waits for has not come")
        except StopIteration:
            return finish()
        except Exception:
            traceback.print_exc()
            report.failures.append(traceback.format_exc(limit=-2))
            return finish()
        return TICK_S

    def finish():
        report.write()
        bpy.ops.wm.quit_blender()

    bpy.app.timers.register(tick, first_interval=1)


bpy.context.preferences.view.show_splash = False
bpy.context.preferences.use_preferences_save = False
the_watch, the_report = Watch(), Report()
run(story(the_watch, the_report), the_watch, the_report)
