"""A user's mouse and keys, sent through the X server; generators for stories.

Positions are px from the window's upper left corner. Blender must notice the mouse before a button is pressed.
"""

import os
import subprocess

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d
from stage import in_view, view_area

# A busy machine answers late.
_SLOWNESS = min(max(os.getloadavg()[0] / (os.cpu_count() or 1), 1), 4)
PAUSE_S = 0.5 * _SLOWNESS
TYPING_MS = "60"
BUTTON_PX = 20
SWEEPS = 4  # of the sidebar, scrolled in between


def xdotool(*words):
    """Does not block Blender's thread: another program may hold the X server until Blender answers."""
    process = subprocess.Popen(["xdotool", *map(str, words)])
    yield lambda: process.poll() is not None


def move(x, y):
    """Two motions: Blender highlights what is under the second."""
    yield from xdotool("mousemove", round(x) - 2, round(y) - 1)
    yield 0.15 * _SLOWNESS
    yield from xdotool("mousemove", round(x), round(y))
    yield 0.3 * _SLOWNESS


def click(x, y, button=1, modifier=None):
    yield from move(x, y)
    yield from xdotool(*(["keydown", modifier] if modifier else []), "mousedown", button)
    yield 0.1
    yield from xdotool("mouseup", button, *(["keyup", modifier] if modifier else []))
    yield PAUSE_S


def press_button(operator):
    """Click the sidebar's button that runs an operator, as `livehand.add_studio`."""
    place = yield from find_button(operator)
    yield from click(*place)


def find_button(operator):
    """Move the mouse down the sidebar until the button under it runs an operator; returns the button's place."""
    left, top, width, height = region_of("UI")
    yield from scroll_to_top()
    step = BUTTON_PX // 2
    for _ in range(SWEEPS):
        for y in range(top + step, top + height, step):
            yield from xdotool("mousemove", left + width // 2, y)
            yield 0.04 * _SLOWNESS
            if f"bpy.ops.{operator}(" in call_under_the_mouse():
                return left + width // 2, y
        yield from xdotool("click", "--repeat", 8, "--delay", 40, 5)
        yield PAUSE_S
    raise RuntimeError(f"no button of the sidebar runs {operator}")


def scroll_to_top():
    left, top, width, height = region_of("UI")
    yield from move(left + width // 2, top + height // 2)
    yield from press("Home")


def call_under_the_mouse():
    """What the sidebar's button under the mouse runs, as Python; empty: nothing."""
    manager = bpy.context.window_manager
    manager.clipboard = ""
    with in_view("UI"):
        if bpy.ops.ui.copy_python_command_button.poll():
            bpy.ops.ui.copy_python_command_button()
    return manager.clipboard


def drag(*points, hold=lambda: None):
    """Press at the first position and release at the last; `hold` is called before the release."""
    yield from move(*points[0])
    yield from xdotool("mousedown", 1)
    yield 0.2
    for place in points[1:]:
        yield from move(*place)
    yield PAUSE_S
    hold()
    yield from xdotool("mouseup", 1)
    yield PAUSE_S


def drag_from_outside(*points):
    """Drag from another program's window in one command, because Blender's event loop is blocked until the drop."""
    words = ["mousemove", *points[0], "sleep", "0.5", "mousedown", 1]
    for place in points[1:]:
        words += ["sleep", "0.4", "mousemove", *map(round, place)]
    yield from xdotool(*words, "sleep", "0.6", "mouseup", 1)
    yield 1


def press(*keys, times=1):
    for key in keys:
        for _ in range(times):
            yield from xdotool("key", key)
            yield 0.1
        yield PAUSE_S - 0.1


def write(text, end="Return"):
    yield from xdotool("type", "--delay", TYPING_MS, text)
    yield PAUSE_S
    if end:
        yield from press(end)


def choose(menu_key, words):
    """From the menu that a key opens over the 3D view, by typing."""
    yield from over_view()
    yield from press(menu_key)
    yield from write(words)


def over_view():
    """The mouse over the 3D view, above the panel of the last operation."""
    area = view_area()
    yield from move(area.x + 0.2 * area.width, from_top(area.y + 0.68 * area.height))


def region_of(kind, area=None):
    """One of an area's regions: its left, top, width and height in px."""
    region = next(region for region in (area or view_area()).regions if region.type == kind)
    return region.x, from_top(region.y + region.height), region.width, region.height


def from_top(y):
    """Blender counts from the window's lower edge."""
    return bpy.context.window_manager.windows[0].height - y


def place_of(point):
    """Where a point of the world lies in the 3D view."""
    area = view_area()
    region = next(region for region in area.regions if region.type == "WINDOW")
    spot = location_3d_to_region_2d(region, area.spaces.active.region_3d, point)
    return region.x + spot.x, from_top(region.y + spot.y)
