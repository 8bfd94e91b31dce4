"""The first hour: poses from the library, and a wave keyed by hand."""

import bpy
import numpy as np
from hour_hands import hand_of, knuckle_of
from stage import module, picture, view_area
from user import click, drag, over_view, place_of, press, press_button, region_of, scroll_to_top, write

SLOT_PX = 77.4  # distance between previews in the asset shelf
FIRST_SLOT = (36, 40)
# From the sidebar's corner: a pop-up's button, which Blender does not name, and what is in it.
AVATAR, DEEP = (160, 224), (268, 373)
WAVE = ((1, -15), (13, 30), (25, -30), (37, 30), (48, -30))  # frame, and rotation of the wrist in degrees


def open_the_shelf(report):
    """Pose mode, the LiveHand tab, *Add Pose Library*."""
    yield from select("right")
    yield from press("ctrl+Tab", "n")
    yield from press("ctrl+KP_6", times=3)  # so that the sidebar does not cover the hand
    report.check(bpy.context.mode == "POSE", "not in pose mode")
    yield from show_tab()
    picture("05_tab", "660x692+398+28")
    yield from press_button("livehand.add_pose_library")
    yield 4  # the shelf loads its previews
    libraries = [library.name for library in bpy.context.preferences.filepaths.asset_libraries]
    report.check("LiveHand" in libraries, "Add Pose Library has added none")
    report.check(region_of("ASSET_SHELF")[3] > 40, "the asset shelf is not open")


def pose_the_hands(report):
    """A click on a preview in the shelf poses the hand that is in pose mode."""
    yield from pick("Spread")
    expect_pose("right", "Spread", report)
    yield from press("ctrl+Tab")
    yield from select("left")
    yield from press("ctrl+Tab")
    yield from pick("Fist")
    expect_pose("left", "Fist", report)
    yield from over_view()
    yield 1
    picture("06_poses", "1056x692+0+28")
    yield from press("ctrl+Tab")
    yield from select("right")
    yield from press("ctrl+Tab")
    yield from over_view()
    expect_pose("right", "Spread", report)


def choose_an_avatar(report):
    """Choose another skin for the right hand by its thumbnail."""
    yield lambda: module("livehand_blender.render.engine").LiveHandRender.preparation.progress is None
    yield from scroll_to_top()
    x, y, *_ = region_of("UI")
    yield from click(x + AVATAR[0], y + AVATAR[1])
    yield 1
    picture("06_avatar", "560x560+640+28")
    yield from click(x + DEEP[0], y + DEEP[1])
    yield from over_view()
    yield 1
    report.check(hand_of("right").livehand.skin == "deep", "the right hand does not have the avatar deep")


def blend_poses(report):
    """Dragging a preview sideways blends its pose in."""

    def hold():
        picture("07_blend", "1056x692+0+28")

    x, y = slot("Fist")
    yield from drag((x, y), (x + 20, y), (x + 60, y - 60), (x + 110, y - 90), hold=hold)
    is_, spread, fist = theta_of("right"), theta_in_library("Spread", "right"), theta_in_library("Fist", "right")
    share = np.linalg.norm(is_ - spread) / np.linalg.norm(fist - spread)
    report.figures["share_of_the_fist_blended_in"] = round(float(share), 2)
    report.check(0.05 < share < 0.95, f"the pose was not blended: {share:.2f}")
    yield from over_view()
    yield from press("ctrl+z")
    yield from pick("Spread")
    expect_pose("right", "Spread", report)


def key_a_wave(report):
    """Rotate the wrist, and key it at five frames with the keying set LiveHand."""
    hand = hand_of("right")
    yield from click(*place_of(hand.matrix_world @ hand.pose.bones["wrist.R"].head))
    report.check([bone.name for bone in bpy.context.selected_pose_bones] == ["wrist.R"], "the wrist is not selected")
    leans = []
    for index, (frame, degrees) in enumerate(WAVE):
        yield from over_view()
        yield from press("Right", times=frame - bpy.context.scene.frame_current)
        yield from write(f"r{degrees}")
        yield from press("k", "End")  # LiveHand comes last
        if index == 1:
            picture("08_key", "1056x770+0+28")
        yield from press("Return")
        leans.append(theta_of("right")[0])
    frames = key_frames("right")
    report.check(frames == [frame for frame, _ in WAVE], f"keys at {frames}")
    for (frame, _), lean in zip(WAVE, leans, strict=True):
        bpy.context.scene.frame_set(frame)
        report.check(np.abs(theta_of("right")[0] - lean).max() < 1e-4, f"the wave is not as keyed at frame {frame}")
        expect_pose("right", "Spread", report)
    angles = [np.linalg.norm(lean) for lean in leans]
    report.figures["wave_deg"] = [round(float(angle), 1) for angle in np.rad2deg(angles)]
    report.check(np.allclose(angles, np.deg2rad(15), atol=0.02), "the wave does not lean by 15 degrees")
    bpy.context.scene.frame_set(1)
    yield from press("ctrl+Tab")


def select(side):
    """Click on the hand in object mode."""
    hand = hand_of(side)
    yield from click(*knuckle_of(side))
    if bpy.context.view_layer.objects.active != hand:
        raise RuntimeError(f"a click did not select {hand.name}")


def show_tab():
    ui = next(region for region in view_area().regions if region.type == "UI")
    for _ in range(3):  # the region has no tabs before it has been drawn
        yield 0.7
        ui.active_panel_category = "LiveHand"
        ui.tag_redraw()
    yield 1


def pick(name):
    yield from click(*slot(name))
    yield from over_view()


def slot(name):
    """Position of a pose in the shelf: Blender sorts by catalog, then by name."""
    poses = module("backend.hand.poses").POSES
    order = sorted(poses, key=lambda each: (poses[each].catalog, each))
    x, y, *_ = region_of("ASSET_SHELF")
    return x + FIRST_SLOT[0] + SLOT_PX * order.index(name), y + FIRST_SLOT[1]


def theta_in_library(name, side):
    """[16, 3] rad."""
    gestures, model = module("backend.hand.gestures"), module("backend.hand.model")
    angles = module("backend.hand.poses").POSES[name].gesture.angles_deg()
    theta = gestures.theta_of(angles, gestures.FingerAxes.of_default_hand())
    return theta if side == "right" else theta * model.MIRROR_AXIS_ANGLE


def theta_of(side):
    return (
        module("livehand_blender.rig.pose").read_hand_pose(hand_of(side), bpy.context.evaluated_depsgraph_get()).theta
    )


def expect_pose(side, name, report):
    off = np.abs(theta_of(side) - theta_in_library(name, side))[1:].max()
    report.check(off < 1e-3, f"the {side} hand is {off:.3f} rad off the pose {name}")


def key_frames(side):
    """All frames with keys."""
    hand = hand_of(side)
    action = hand.animation_data.action if hand.animation_data else None
    curves = action.fcurves if action else ()
    return sorted({round(point.co.x) for curve in curves for point in curve.keyframe_points})
