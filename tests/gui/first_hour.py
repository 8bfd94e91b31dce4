"""A story: docs/use/walkthrough.md step by step with mouse and keys; each step has a screenshot and is checked.

Positions of buttons are those of Blender 4.3 in a window of 1280 x 800.
"""

import sys
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from hour_hands import add_both_hands
from hour_motion import drop_the_take, import_the_take
from hour_posing import blend_poses, choose_an_avatar, key_a_wave, open_the_shelf, pose_the_hands
from hour_rendering import aim_the_camera, render_the_film, render_the_still, see_it_rendered
from stage import Report, run_story


def story(report):
    # Without a window manager, keys are lost after a second window has closed, so no second window is opened.
    view = bpy.context.preferences.view
    view.filebrowser_display_type = view.render_display_type = "SCREEN"
    bpy.context.scene.render.fps = 24
    yield from add_both_hands(report)
    yield from open_the_shelf(report)
    yield from pose_the_hands(report)
    yield from choose_an_avatar(report)
    yield from blend_poses(report)
    yield from key_a_wave(report)
    yield from drop_the_take(report)
    yield from import_the_take(report)
    yield from aim_the_camera(report)
    yield from see_it_rendered(report)
    yield from render_the_still(report)
    yield from render_the_film(report)


the_report = Report()
run_story(story(the_report), the_report)
