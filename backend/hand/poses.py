"""The pose library: named hand poses as joint angles, ready to be written as Blender pose assets.

Angles as in `gestures`: degrees from the built-in hand's rest pose, in which a finger is bent by about 11 (MCP), 12
(PIP) and 7 (DIP). Grasps are named and numbered after Feix, Romero, Schmiedmayer, Dollar and Kragic 2016, "The GRASP
Taxonomy of Human Grasp Types". Where thumb and finger pinch, both were fitted so that they touch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .gestures import GESTURES, Degrees, Flexion, Gesture

Thumb = tuple[tuple[Degrees, Degrees, Degrees], ...]


@dataclass(frozen=True)
class LibraryPose:
    """One pose of the library.

    Attributes:
        catalog: the heading it stands under.
        gesture: its joint angles.
        description: one line for people.
        tags: words to find it by.
        seen_from: where its picture is taken from.
    """

    catalog: str
    gesture: Gesture
    description: str
    tags: tuple[str, ...] = ()
    seen_from: Literal["palm", "thumb"] = "palm"


_STRAIGHT = (-10, -11, -6)
_CLOSED: Flexion = {"index": (74, 92, 62), "middle": (75, 92, 64), "ring": (75, 92, 64), "pinky": (74, 90, 64)}
_CLOSED_SIDEWAYS: dict[str, Degrees] = {"index": 2, "ring": -1, "pinky": 1}
_THUMB_ON_FINGERS: Thumb = ((12, -3, -6), (32, 0, 0), (52, 0, 0))
_THUMB_OUT: Thumb = ((-22, 0, 0), (-10, 0, 0), (-12, 0, 0))
_THUMB_IN_PALM: Thumb = ((34, -6, 14), (40, 0, 0), (40, 0, 0))


def _flexed(mcp: Degrees, pip: Degrees, dip: Degrees) -> Flexion:
    return {finger: (mcp, pip, dip) for finger in ("index", "middle", "ring", "pinky")}


def _held_up(*fingers: str, thumb: Thumb = _THUMB_ON_FINGERS, spread: dict[str, Degrees] | None = None) -> Gesture:
    """These fingers straight, the others closed."""
    flexion = {finger: _STRAIGHT if finger in fingers else closed for finger, closed in _CLOSED.items()}
    sideways = {finger: angle for finger, angle in _CLOSED_SIDEWAYS.items() if finger not in fingers}
    return Gesture(flexion, sideways | (spread or {}), thumb)


POSES: dict[str, LibraryPose] = {
    "Open": LibraryPose("Basic", GESTURES["open"], "Open hand, fingers slightly apart"),
    "Spread": LibraryPose("Basic", GESTURES["spread"], "Fingers as far apart as they go", ("five",)),
    "Flat": LibraryPose(
        "Basic",
        Gesture(_flexed(*_STRAIGHT), {"index": -3, "ring": 3, "pinky": 5}, ((4, 0, 0), (-4, 0, 0), (-10, 0, 0))),
        "Straight fingers side by side",
        ("stop", "salute"),
    ),
    "Relaxed": LibraryPose("Basic", GESTURES["relaxed"], "A hand that does nothing", ("rest",), "thumb"),
    "Loose Fist": LibraryPose(
        "Basic",
        Gesture(
            {"index": (52, 62, 32), "middle": (58, 66, 34), "ring": (62, 68, 35), "pinky": (62, 66, 34)},
            {"pinky": 2},
            ((7, -9, -8), (22, 0, 0), (8, 0, 0)),
        ),
        "Half-closed hand",
        ("relaxed",),
        "thumb",
    ),
    "Fist": LibraryPose("Basic", Gesture(_CLOSED, _CLOSED_SIDEWAYS, _THUMB_ON_FINGERS), "Closed fist, thumb outside"),
    "Claw": LibraryPose(
        "Basic",
        Gesture(
            _flexed(-14, 52, 34),
            {"index": 7, "middle": 1, "ring": -5, "pinky": -10},
            ((-8, 0, 6), (8, 0, 0), (44, 0, 0)),
        ),
        "Spread fingers, bent at their middle joints",
        ("monster",),
    ),
    "Point": LibraryPose("Gestures", _held_up("index"), "Index finger straight", ("index", "there")),
    "Thumbs Up": LibraryPose("Gestures", Gesture(_CLOSED, _CLOSED_SIDEWAYS, _THUMB_OUT), "Thumb up", ("like", "good")),
    "Finger Gun": LibraryPose("Gestures", _held_up("index", thumb=_THUMB_OUT), "Index straight, thumb up", ("L",)),
    "Victory": LibraryPose(
        "Gestures",
        _held_up("index", "middle", spread={"index": 10, "middle": -7}),
        "Index and middle finger apart",
        ("peace", "V", "two"),
    ),
    "Horns": LibraryPose("Gestures", _held_up("index", "pinky"), "Index and little finger straight", ("rock",)),
    "Call Me": LibraryPose(
        "Gestures",
        _held_up("pinky", thumb=_THUMB_OUT, spread={"pinky": -12}),
        "Thumb and little finger out",
        ("shaka", "phone"),
    ),
    "I Love You": LibraryPose(
        "Gestures", _held_up("index", "pinky", thumb=_THUMB_OUT), "Thumb, index and little finger out", ("ILY", "sign")
    ),
    "Vulcan": LibraryPose(
        "Gestures",
        Gesture(
            _flexed(*_STRAIGHT),
            {"index": 2, "middle": 9, "ring": -11, "pinky": -5},
            ((-16, 0, 0), (-8, 0, 0), (-12, 0, 0)),
        ),
        "Fingers parted in the middle",
        ("salute",),
    ),
    "Beckon": LibraryPose(
        "Gestures",
        Gesture(_CLOSED | {"index": (20, 62, 40)}, _CLOSED_SIDEWAYS, _THUMB_ON_FINGERS),
        "Index finger calls",
        ("come",),
    ),
    "OK": LibraryPose(
        "Gestures",
        Gesture(
            {"index": (31, 50, 22), "middle": (10, 14, 6), "ring": (0, 6, 2), "pinky": (-8, 0, 0)},
            {"index": -4, "ring": -4, "pinky": -8},
            ((21, -6, 5), (9, 0, 0), (11, 0, 0)),
        ),
        "Ring of thumb and index finger",
        ("good", "perfect"),
        "thumb",
    ),
    "One": LibraryPose("Counting", _held_up("index"), "One, from the index finger", ("1",)),
    "Two": LibraryPose("Counting", _held_up("index", "middle", spread={"index": 6, "middle": -3}), "Two", ("2",)),
    "Three": LibraryPose(
        "Counting",
        Gesture(
            {"index": _STRAIGHT, "middle": _STRAIGHT, "ring": _STRAIGHT, "pinky": (84, 44, 50)},
            {"index": 7, "ring": -6},
            ((42, -10, -8), (26, 0, 0), (46, 0, 0)),
        ),
        "Three, thumb on the little finger",
        ("3",),
    ),
    "Four": LibraryPose(
        "Counting",
        _held_up(
            "index",
            "middle",
            "ring",
            "pinky",
            thumb=_THUMB_IN_PALM,
            spread={"index": 7, "middle": 1, "ring": -5, "pinky": -10},
        ),
        "Four, thumb in the palm",
        ("4",),
    ),
    "Five": LibraryPose(
        "Counting",
        Gesture(
            _flexed(*_STRAIGHT),
            {"index": 8, "middle": 1, "ring": -6, "pinky": -11},
            ((-16, 0, 0), (-8, 0, 0), (-12, 0, 0)),
        ),
        "Five",
        ("5",),
    ),
    "Large Diameter": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (30, 38, 22), "middle": (32, 38, 22), "ring": (34, 38, 22), "pinky": (36, 38, 22)},
            {"index": 3, "ring": -2, "pinky": -4},
            ((4, 0, 10), (10, 0, 0), (16, 0, 0)),
        ),
        "Round a jar (GRASP 1, Large Diameter)",
        ("power", "cylinder", "bottle"),
        "thumb",
    ),
    "Small Diameter": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (64, 78, 42), "middle": (66, 78, 42), "ring": (68, 78, 42), "pinky": (68, 76, 42)},
            {"index": 2, "ring": -1},
            ((17, 3, 0), (24, 0, 0), (24, 0, 0)),
        ),
        "Round a rail (GRASP 2, Small Diameter)",
        ("power", "cylinder", "bar"),
        "thumb",
    ),
    "Medium Wrap": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (52, 58, 30), "middle": (54, 58, 30), "ring": (56, 58, 30), "pinky": (56, 56, 30)},
            {"index": 1, "ring": -1, "pinky": -2},
            ((18, 0, 10), (10, 0, 0), (14, 0, 0)),
        ),
        "Round a handle (GRASP 3, Medium Wrap)",
        ("power", "cylinder", "hammer"),
        "thumb",
    ),
    "Prismatic 4 Finger": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (46, 29, 19), "middle": (48, 28, 21), "ring": (48, 28, 21), "pinky": (46, 28, 20)},
            {"ring": 1, "pinky": 3},
            ((34, -11, 30), (5, 0, 0), (0, 0, 0)),
        ),
        "A pencil between thumb and four fingertips (GRASP 6, Prismatic 4 Finger)",
        ("precision",),
        "thumb",
    ),
    "Palmar Pinch": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (31, 47, 34), "middle": (32, 30, 14), "ring": (26, 26, 12), "pinky": (20, 22, 10)},
            {"index": -6},
            ((26, -12, 0), (2, 0, 0), (0, 0, 0)),
        ),
        "Pads of thumb and index finger (GRASP 9, Palmar Pinch)",
        ("precision", "pinch"),
        "thumb",
    ),
    "Power Disk": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (4, 46, 30), "middle": (4, 46, 30), "ring": (4, 46, 30), "pinky": (4, 46, 30)},
            {"index": 11, "middle": 2, "ring": -9, "pinky": -15},
            ((-8, -6, 6), (4, 0, 0), (30, 0, 0)),
        ),
        "Over a lid (GRASP 10, Power Disk)",
        ("power", "jar lid"),
        "thumb",
    ),
    "Power Sphere": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (28, 38, 24), "middle": (30, 40, 25), "ring": (32, 40, 25), "pinky": (34, 40, 25)},
            {"index": 9, "middle": 2, "ring": -7, "pinky": -14},
            ((6, 0, 14), (10, 0, 0), (18, 0, 0)),
        ),
        "Round a ball, palm on it (GRASP 11, Power Sphere)",
        ("power", "ball", "apple"),
        "thumb",
    ),
    "Precision Sphere": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (36, 36, 18), "middle": (40, 36, 18), "ring": (40, 36, 18), "pinky": (40, 36, 18)},
            {"index": 9, "middle": 2, "ring": -7, "pinky": -14},
            ((8, -6, 10), (4, 0, 0), (12, 0, 0)),
        ),
        "Fingertips round a ball (GRASP 13, Precision Sphere)",
        ("precision", "ball"),
        "thumb",
    ),
    "Tripod": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (31, 28, 18), "middle": (37, 42, 29), "ring": (50, 54, 26), "pinky": (50, 54, 26)},
            {"index": -4},
            ((26, -16, 18), (2, 0, 0), (0, 0, 0)),
        ),
        "Thumb, index and middle finger (GRASP 14, Tripod)",
        ("precision",),
        "thumb",
    ),
    "Fixed Hook": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (2, 78, 45), "middle": (2, 78, 45), "ring": (2, 78, 45), "pinky": (2, 78, 45)},
            {"pinky": 2},
            ((4, 0, 8), (12, 0, 0), (20, 0, 0)),
        ),
        "A bag hangs from the fingers (GRASP 15, Fixed Hook)",
        ("hook", "carry"),
        "thumb",
    ),
    "Lateral": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (47, 63, 34), "middle": (58, 72, 40), "ring": (62, 74, 40), "pinky": (62, 72, 40)},
            {"index": 7},
            ((7, -11, -8), (12, 0, 0), (10, 0, 0)),
        ),
        "Thumb on the side of the index finger (GRASP 16, Lateral)",
        ("key", "card"),
        "thumb",
    ),
    "Index Finger Extension": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (18, 10, 4), "middle": (62, 72, 38), "ring": (64, 72, 38), "pinky": (64, 70, 38)},
            {},
            ((33, -8, -8), (1, 0, 0), (9, 0, 0)),
        ),
        "A knife, index finger along it (GRASP 17, Index Finger Extension)",
        ("knife",),
        "thumb",
    ),
    "Writing Tripod": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (33, 39, 21), "middle": (50, 52, 24), "ring": (54, 62, 30), "pinky": (54, 62, 30)},
            {"index": -2, "middle": 1, "ring": 1, "pinky": 2},
            ((22, -11, 7), (4, 0, 0), (0, 0, 0)),
        ),
        "A pen (GRASP 20, Writing Tripod)",
        ("pen", "write", "precision"),
        "thumb",
    ),
    "Parallel Extension": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (58, -6, -4), "middle": (58, -6, -4), "ring": (58, -6, -4), "pinky": (58, -6, -4)},
            {"index": 1, "ring": -1, "pinky": -2},
            ((40, 0, 0), (-10, 0, 0), (-10, 0, 0)),
        ),
        "Straight fingers, a book (GRASP 22, Parallel Extension)",
        ("book", "flat"),
        "thumb",
    ),
    "Tip Pinch": LibraryPose(
        "Grasps",
        Gesture(
            {"index": (32, 48, 32), "middle": (36, 40, 20), "ring": (34, 40, 20), "pinky": (32, 38, 18)},
            {"index": -3},
            ((20, -8, 8), (6, 0, 0), (20, 0, 0)),
        ),
        "Tips of thumb and index finger (GRASP 24, Tip Pinch)",
        ("precision", "needle"),
        "thumb",
    ),
}
