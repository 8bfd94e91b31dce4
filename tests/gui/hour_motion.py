"""The first hour: a tracked take onto the left hand, through the file browser and as a dropped file."""

import shutil
import subprocess
from pathlib import Path

import bpy
import numpy as np
from hour_hands import hand_of
from hour_posing import key_frames, select
from stage import module, picture
from user import choose, click, drag_from_outside, from_top, over_view, place_of, press, region_of

EXAMPLES = Path(__file__).parents[2] / "examples"
TAKE_FRAMES = 47  # two seconds, 12 a second, at the scene's 24
FIRST_ROW_PX = 31  # from the list's upper edge to the first file's middle
IMPORT_BUTTON = (75, 24)  # from the lower right corner of the file browser
HEADS = {"wrist": (0,), "thumb": (1, 2, 3), "index": (5, 6, 7), "middle": (9, 10, 11), "ring": (13, 14, 15)}
HEADS |= {"pinky": (17, 18, 19)}  # MediaPipe's numbers of the joints that are heads of bones
MOST_OFF_M = 0.008  # rms, of joints and landmarks: fitted, and smoothed over a frame


def import_the_take(report):
    """*File > Import > LiveHand Motion*, by the file browser."""
    yield from select("left")
    yield from show_the_menu()
    left = hand_of("left")
    before = np.array(left.matrix_world @ left.pose.bones["wrist.L"].head)
    yield from choose("F3", "import livehand motion")
    yield lambda: area_with("FILE_BROWSER") is not None
    yield 1
    area = area_with("FILE_BROWSER")
    area.spaces.active.params.directory = str(folder_with_the_take()).encode()
    yield 2
    x, y, *_ = region_of("WINDOW", area)
    yield from click(x + 100, y + FIRST_ROW_PX)
    yield 1.5
    picture("10_browser", geometry_of(area), width=1056)
    x, y, width, height = region_of("EXECUTE", area)
    yield from click(x + width - IMPORT_BUTTON[0], y + height - IMPORT_BUTTON[1])
    yield lambda: hand_of("left").animation_data is not None
    yield 1
    yield from over_view()
    expect_the_take(before, report)
    bpy.context.scene.frame_set(30)
    yield 1
    picture("11_imported", "1056x692+0+28")
    bpy.context.scene.frame_set(1)


def show_the_menu():
    yield from click(46, 14)
    yield from click(82, 310)
    picture("09_menu", "600x560+0+0")
    yield from press("Escape", "Escape")


def folder_with_the_take():
    folder = Path("/tmp/livehand/examples")
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copy(EXAMPLES / "take.json", folder)
    return folder


def area_with(kind):
    """The area with an editor of a kind, or None."""
    areas = bpy.context.window_manager.windows[0].screen.areas
    return next((area for area in areas if area.type == kind), None)


def geometry_of(area):
    """The area for a screenshot: WxH+X+Y."""
    return f"{area.width}x{area.height}+{area.x}+{from_top(area.y + area.height)}"


def expect_the_take(wrist_before, report):
    """Check keys, joints and location against the file."""
    frames = key_frames("left")
    report.check(frames == list(range(1, TAKE_FRAMES + 1)), f"the take's keys are at {frames[:3]}...{frames[-3:]}")
    points = np.array(
        module("backend.motion.document").load_document(EXAMPLES / "take.json").content["world_landmarks"]
    )
    worst = 0.0
    for index in (0, 7, 12, 18, 23):
        bpy.context.scene.frame_set(1 + 2 * index)
        seen = heads_of("left")
        expected = points[index][[number for numbers in HEADS.values() for number in numbers]] @ [
            [1, 0, 0],
            [0, 0, -1],
            [0, 1, 0],
        ]
        off = (seen - seen.mean(0)) - (expected - expected.mean(0))
        worst = max(worst, float(np.sqrt((off**2).sum(-1).mean())))
        moved = np.linalg.norm(seen[0] - wrist_before)
        report.check(moved < 1e-4, f"the import moved the wrist by {moved:.3f} m though the file has no places")
    report.figures["take_rms_mm"] = round(1000 * worst, 1)
    report.check(worst < MOST_OFF_M, f"the hand is {1000 * worst:.1f} mm off the take")


def heads_of(side):
    """[16, 3] m in the world, in the order of `HEADS`."""
    names = [
        f"{name}{number + 1}" if name != "wrist" else name
        for name, many in HEADS.items()
        for number in range(len(many))
    ]
    hand, suffix = hand_of(side), f".{side[0].upper()}"
    return np.array([hand.matrix_world @ hand.pose.bones[name + suffix].head for name in names])


def drop_the_take(report):
    """Drag the same file from another program's window onto the hand; needs Tk and tkdnd."""
    x, y, size = 20, 640, (160, 60)
    script = [Path(__file__).with_name("drag_source.py"), folder_with_the_take() / "take.json", x, y]
    source = subprocess.Popen(["python3", *map(str, script)], stderr=subprocess.PIPE, text=True)
    yield 2
    if source.poll() is not None:
        report.figures["dropped"] = f"not tried: {source.stderr.read().strip().splitlines()[-1]}"
        return
    bpy.context.scene.frame_set(12)
    yield from select("left")
    target = place_of(hand_of("left").matrix_world.translation)
    start = (x + size[0] // 2, y + size[1] // 2)
    yield from drag_from_outside(
        start, (start[0] + 30, start[1] - 10), (start[0] + 120, start[1] - 120), (target[0] - 9, target[1]), target
    )
    picture("12_dropped", "640x780+0+0")
    yield from press("Return")
    yield 1
    report.check(hand_of("left").animation_data is not None, "a dropped file was not imported")
    if hand_of("left").animation_data is not None:
        frames = key_frames("left")
        report.check((frames[0], len(frames)) == (12, TAKE_FRAMES), f"the dropped take's keys begin at {frames[0]}")
        report.figures["dropped"] = "imported from the current frame on"
    source.terminate()
    # Undo the import, because the next step repeats it by the file browser.
    hand_of("left").animation_data_clear()
    yield from over_view()
    bpy.context.scene.frame_set(1)
