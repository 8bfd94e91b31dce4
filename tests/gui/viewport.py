"""A story: the hand in Rendered shading while it moves, the view turns and an animation plays; with timings."""

import resource
import statistics
import subprocess
import sys
import time
from pathlib import Path

import bpy
import numpy as np
from mathutils import Euler

sys.path.insert(0, str(Path(__file__).parent))
from stage import Report, in_view, module, run_story, screenshot, skin, view_area, view_of

FIRST_IMAGE_S = 0.5
LONGEST_BLOCK_S = 0.1
POSE_CHANGES = 7
PLAYING_S = 6
REST_S, BUSY_SHARE = 4, 0.3  # of one core, while nothing is drawn


class Watch:
    """Measures when images reach the view, LiveHand's time in Blender's thread, and how long the thread is blocked."""

    def __init__(self):
        self.pictures = []  # (when, larger side, px)
        self.hooks = []  # (when it began, seconds)
        self.gaps = []  # (when it began, seconds) between two ticks of the event loop
        self._last_tick = time.perf_counter()

    def look_at(self, viewport):
        """Watch the add-on's module `viewport.viewport`."""
        watch, texture_class = self, viewport.ImageTexture

        class WatchedTexture(texture_class):
            def upload(self, until_s):
                is_whole = super().upload(until_s)
                if is_whole:
                    watch.pictures.append((time.perf_counter(), max(self.image.rgba.shape)))
                return is_whole

        viewport.ImageTexture = WatchedTexture
        for name in ("update", "draw"):
            setattr(viewport.Viewport, name, self._timed(getattr(viewport.Viewport, name)))

    def _timed(self, hook):
        def timed(*args):
            start = time.perf_counter()
            hook(*args)
            self.hooks.append((start, time.perf_counter() - start))

        return timed

    def tick(self):
        now = time.perf_counter()
        self.gaps.append((self._last_tick, now - self._last_tick))
        self._last_tick = now

    def longest_block(self, since):
        return longest(self.gaps, since)

    def pictures_since(self, since):
        return [(when - since, size) for when, size in self.pictures if when > since]


def longest(spans, since):
    return round(max((seconds for start, seconds in spans if start >= since), default=0.0), 3)


def peak_memory_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1000


def set_the_scene():
    """A hand on a table before a blue wall, with two other things; one second of motion."""
    scene = bpy.context.scene
    bpy.data.objects.remove(bpy.data.objects["Cube"])
    bpy.ops.livehand.add_hand(side="right")
    hand = bpy.context.object
    hand.rotation_euler = (Euler((0, 0, 0.6)).to_matrix() @ hand.rotation_euler.to_matrix()).to_euler()
    bpy.ops.livehand.set_engine()
    add_thing("plane", (0, 0.3, 0), 3.0, (0.05, 0.1, 0.3), (1.5708, 0, 0))
    add_thing("plane", (0, 0, -0.112), 3.0, (0.3, 0.33, 0.4))
    add_thing("sphere", (0.12, 0.06, -0.062), 0.05, (0.1, 0.3, 0.6))
    add_thing("cube", (-0.14, 0.08, -0.072), 0.08, (0.5, 0.5, 0.55), (0, 0, 0.5))
    light = bpy.data.objects["Light"]
    light.data.type, light.data.energy, light.data.size = "AREA", 12, 0.5
    light.location, light.rotation_euler = (-0.6, -0.6, 0.8), (0.8, 0, -0.785)
    camera = scene.camera
    camera.location, camera.rotation_euler = (0, -0.62, 0.03), (1.53, 0, 0)
    camera.data.lens, camera.data.clip_start = 50, 0.01
    scene.render.resolution_x, scene.render.resolution_y = 640, 512
    # Some Blenders are built without a denoiser.
    scene.cycles.use_denoising = scene.cycles.use_preview_denoising = False
    scene.cycles.samples = scene.cycles.preview_samples = 24
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
    for frame, share in ((1, 0.0), (13, 1.0), (24, 0.0)):
        bend_fingers(hand, share)
        for bone in fingers(hand):
            bone.keyframe_insert("rotation_quaternion", frame=frame)


def fingers(hand):
    return [bone for bone in hand.pose.bones if bone.name.startswith(("index", "middle", "ring", "pinky"))]


def bend_fingers(hand, share):
    """From straight (0) to half closed (1)."""
    for bone in fingers(hand):
        bone.rotation_mode = "QUATERNION"
        bone.rotation_quaternion = Euler((0.9 * share, 0, 0)).to_quaternion()


def story(watch, report):
    engine = module("livehand_blender.render.engine").LiveHandRender
    watch.look_at(module("livehand_blender.render.viewport"))
    hand = set_the_scene()
    yield from pose_in_the_tab(hand)
    space = view_area().spaces.active
    space.region_3d.view_perspective = "CAMERA"
    space.region_3d.view_camera_zoom = 29
    space.overlay.show_overlays = False  # bones and outlines are drawn in orange, which might pass for skin
    yield from compare_with_cycles(hand, space, watch, report)
    yield from see_the_first_picture(watch, report)
    yield from move_the_fingers(hand, watch, report)
    yield from turn_the_view(space, watch, report)
    yield from turn_orthographic(watch, space, report)
    yield from read_messages(hand, space, report)
    yield from play(watch, report)
    yield from let_cycles_end(report)
    yield from render_a_still(space, report)
    space.shading.type = "SOLID"
    yield 2
    report.check(not bpy.app.timers.is_registered(engine.viewport_shared.timer._callback), "a timer is left behind")


def pose_in_the_tab(hand):
    """The sidebar's tab, with the hand in pose mode."""
    space = view_area().spaces.active
    space.region_3d.view_perspective = "PERSP"
    space.region_3d.view_location, space.region_3d.view_distance = (0.04, 0, -0.005), 0.38
    space.region_3d.view_rotation = Euler((1.3, 0, -0.5)).to_quaternion()
    space.show_region_ui = True
    bpy.ops.object.mode_set(mode="POSE")
    for thing in bpy.context.scene.objects:
        thing.hide_set(thing.type in ("MESH", "LIGHT", "CAMERA") and thing != hand.livehand.mesh)
    bpy.context.scene.frame_set(6)
    ui = next(region for region in view_area().regions if region.type == "UI")
    for _ in range(4):  # the region has no tabs before it has been drawn
        yield 1
        ui.active_panel_category = "LiveHand"
        ui.tag_redraw()
    yield 1
    screenshot("posing")
    bpy.ops.object.mode_set(mode="OBJECT")
    for thing in bpy.context.scene.objects:
        thing.hide_set(False)
    space.show_region_ui = False
    bpy.context.scene.frame_set(1)
    yield 1


def compare_with_cycles(hand, space, watch, report):
    """For comparison: how long Blender is blocked when the hand moves and Cycles alone renders the scene."""
    bpy.context.scene.render.engine = "CYCLES"
    space.shading.type = "RENDERED"
    yield 5
    report.figures["memory_before_mb"] = peak_memory_mb()
    start = time.perf_counter()
    for share in np.linspace(0, 0.6, POSE_CHANGES):
        bend_fingers(hand, share)
        yield 2
    report.figures["longest_block_of_cycles_alone_s"] = watch.longest_block(start)


def see_the_first_picture(watch, report):
    """The avatar is loaded."""
    start = time.perf_counter()
    bpy.context.scene.render.engine = "LIVEHAND"
    yield lambda: len(watch.pictures_since(start)) >= 2
    report.figures["first_picture_with_loading_s"] = round(watch.pictures_since(start)[0][0], 2)
    report.figures["longest_block_while_loading_s"] = watch.longest_block(start)
    report.figures["memory_with_avatar_mb"] = peak_memory_mb()
    yield 5


def move_the_fingers(hand, watch, report):
    """Every pose must show a coarse image first and then a fine one."""
    first, refined = [], []
    before = skin(view_of(screenshot("before")))
    report.check(before.mean() > 0.04, "no hand in the view")
    began = time.perf_counter()
    for share in np.linspace(0.5, 0, POSE_CHANGES):
        start = time.perf_counter()
        bend_fingers(hand, share)
        yield lambda start=start: len(watch.pictures_since(start)) >= 2
        (first_s, coarse_px), (refined_s, fine_px) = watch.pictures_since(start)[:2]
        report.check(coarse_px < fine_px, "the first picture is not the coarse one")
        first.append(first_s)
        refined.append(refined_s)
        yield 2
    report.figures["first_image_s"] = [round(seconds, 2) for seconds in sorted(first)]
    report.figures["refined_s"] = [round(seconds, 2) for seconds in sorted(refined)]
    report.figures["longest_block_s"] = watch.longest_block(began)
    report.figures["longest_in_livehand_s"] = longest(watch.hooks, began)
    report.check(statistics.median(first) <= FIRST_IMAGE_S, "the first image comes too late")
    report.check(longest(watch.hooks, began) <= LONGEST_BLOCK_S, "LiveHand blocks the interface")
    after = skin(view_of(screenshot("after")))
    report.check((before != after).mean() > 0.01, "the hand has not moved in the view")


def turn_the_view(space, watch, report):
    """A free view of the hand from the side."""
    view = space.region_3d
    view.view_perspective = "PERSP"
    view.view_location, view.view_distance = (0, 0, 0), 0.6
    yield 1
    start = time.perf_counter()
    view.view_rotation = Euler((1.4, 0, 0.9)).to_quaternion()
    yield lambda: len(watch.pictures_since(start)) >= 2
    report.figures["first_image_of_a_turned_view_s"] = round(watch.pictures_since(start)[0][0], 2)
    yield 4
    report.check(skin(view_of(screenshot("free"))).mean() > 0.01, "no hand in the free view")


def turn_orthographic(watch, space, report):
    """Show the hand rendered in an orthographic view, where animators pose."""
    start = time.perf_counter()
    space.region_3d.view_perspective = "ORTHO"
    yield lambda: len(watch.pictures_since(start)) >= 2
    yield 2
    report.check(skin(view_of(screenshot("orthographic"))).mean() > 0.01, "no hand in an orthographic view")


def read_messages(hand, space, report):
    """Views that cannot be rendered show the hand's mesh."""
    space.region_3d.view_perspective = "CAMERA"
    hand.livehand.avatar_path = "/missing.safetensors"
    yield 3
    report.check(skin(view_of(screenshot("no_avatar"))).mean() > 0.01, "no mesh for a hand without an avatar")
    hand.livehand.avatar_path = ""


def play(watch, report):
    """Images while an animation plays, and a fine one when it stops."""
    yield 3
    start, frames = time.perf_counter(), set()

    def has_played():
        frames.add(bpy.context.scene.frame_current)
        return time.perf_counter() > start + PLAYING_S

    with in_view():
        bpy.ops.screen.animation_play()
    yield has_played
    pictures = watch.pictures_since(start)
    report.figures["pictures_per_second_playing"] = round(len(pictures) / PLAYING_S, 1)
    report.figures["longest_in_livehand_playing_s"] = longest(watch.hooks, start)
    report.check(len(frames) > 12, "the animation does not play")
    report.check(len(pictures) > PLAYING_S, "the hand stands still while the animation plays")
    stop = time.perf_counter()
    with in_view():
        bpy.ops.screen.animation_cancel(restore_frame=False)
    yield lambda: any(size > 150 for _, size in watch.pictures_since(stop))
    bpy.context.scene.frame_set(6)
    yield 30
    report.check(skin(view_of(screenshot("viewport"))).mean() > 0.04, "no hand after playing")


def let_cycles_end(report):
    """In Hand Only, Cycles takes one sample of the scene, and then rests."""
    start, used = time.perf_counter(), [(time.perf_counter(), time.process_time())]

    def is_at_rest():
        now = time.perf_counter(), time.process_time()
        if now[0] - used[-1][0] < REST_S:
            return False
        share = (now[1] - used[-1][1]) / (now[0] - used[-1][0])
        used.append(now)
        return share < BUSY_SHARE

    yield is_at_rest
    report.figures["cycles_rests_after_s"] = round(time.perf_counter() - start, 1)


def render_a_still(space, report):
    """F12, pressed: the hand in its scene."""
    scene, done = bpy.context.scene, []
    scene.livehand.mode, scene.render.film_transparent = "SCENE", False
    bpy.app.handlers.render_complete.append(lambda *_: done.append(True))
    subprocess.run(["xdotool", "mousemove", "500", "400", "sleep", "0.5", "key", "F12"], check=True)
    yield lambda: done
    yield 3
    picture = screenshot("f12")[180:660, 190:810]  # within the render's window
    report.check(skin(picture).mean() > 0.04, "no hand in the still")
    red, _, blue = np.moveaxis(picture, -1, 0)
    report.check((blue > 1.5 * red).mean() > 0.3, "no blue wall in the still")


the_watch, the_report = Watch(), Report()
run_story(story(the_watch, the_report), the_report, the_watch.tick)
