"""The first hour: an empty scene, a right hand, a left one beside it."""

import bpy
from stage import picture
from user import choose, click, move, over_view, place_of, press, region_of, write


def add_both_hands(report):
    """Add a right hand at the cursor and a left one 20 cm to its left: your own hands, seen from behind."""
    yield from over_view()
    yield from press("a", "x", "Return")
    report.check(not bpy.context.scene.objects, "the scene is not empty")
    yield from click(283, 41)
    for place in ((320, 219), (505, 221), (507, 243)):
        yield from move(*place)
    picture("01_add", "900x500+0+28")
    yield from added(click(507, 243))
    yield from over_view()
    yield from press("KP_1", "KP_Decimal")
    picture("02_hand", "1056x692+0+28")
    yield from added(choose("shift+a", "livehand"))
    yield from turn_into_a_left_one()
    picture("03_side", "400x190+20+540")
    yield from over_view()
    yield from write("gx-0.2")
    x, y, *_ = region_of("HUD")
    yield from click(x + 14, y + 14)  # collapse it: an import's tall panel would receive the view's keys
    yield from over_view()
    yield from frame_both()
    picture("04_both", "1056x692+0+28")
    sides = sorted(thing.livehand.side for thing in bpy.context.scene.objects if thing.livehand.is_hand)
    report.check(sides == ["left", "right"], f"not a right and a left hand, but {sides}")
    report.check(hand_of("right").location.length == 0, "the right hand is not at the cursor")
    report.check(abs(hand_of("left").location.x + 0.2) < 1e-6, "the left hand has not been moved")


def frame_both():
    """Select the right hand, too: *View All* would show the studio's lights, and the hands as specks."""
    for _ in range(3):  # a busy machine loses a modifier
        if not hand_of("right").select_get():
            yield from click(*knuckle_of("right"), modifier="shift")
    if not all(hand_of(side).select_get() for side in ("left", "right")):
        raise RuntimeError("a click with Shift did not select both hands")
    yield from over_view()
    yield from press("KP_Decimal")
    yield 1


def knuckle_of(side):
    """Where the middle finger's ring is seen: a click selects the hand."""
    hand = hand_of(side)
    return place_of(hand.matrix_world @ hand.pose.bones[f"middle1.{side[0].upper()}"].head)


def hand_of(side):
    """Looked up each time, because an undo replaces all objects."""
    hands = (thing for thing in bpy.context.scene.objects if thing.livehand.is_hand)
    return next(hand for hand in hands if hand.livehand.side == side)


def added(steps):
    """Run the steps, and check that they added a hand."""
    before = count_hands()
    yield from steps
    if count_hands() != before + 1 or not bpy.context.object.livehand.is_hand:
        raise RuntimeError("Add > Armature > LiveHand Hand did not add a hand")


def count_hands():
    return sum(thing.livehand.is_hand for thing in bpy.context.scene.objects)


def turn_into_a_left_one():
    """The panel of the last operation, in the view's lower left corner: closed at first."""
    x, y, width, height = region_of("HUD")
    yield from click(x + width / 2, y + height / 2)
    x, y, width, height = region_of("HUD")
    yield from click(x + 0.7 * width, y + 44)
    yield from press("l")
