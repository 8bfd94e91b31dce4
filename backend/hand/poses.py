"""The pose library: named hand poses as joint angles, for Blender's pose assets.

Angles are those of `gestures`: degrees from the built-in hand's rest pose, in which a finger is bent by about 11 (MCP),
12 (PIP) and 7 (DIP). Grasps are named and numbered after Feix, Romero, Schmiedmayer, Dollar and Kragic 2016, "The GRASP
Taxonomy of Human Grasp Types". In pinches, thumb and finger were fitted so that they touch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .gestures import GESTURES, Degrees, Gesture

View = Literal["palm", "thumb"]
_FINGERS = ("index", "middle", "ring", "pinky")


@dataclass(frozen=True)
class LibraryPose:
    """One pose of the library.

    Attributes:
        catalog: of Blender's asset library.
        gesture: the joint angles.
        description: one line for people.
        tags: search words.
        seen_from: the side from which its preview is rendered.
    """

    catalog: str
    gesture: Gesture
    description: str
    tags: tuple[str, ...] = ()
    seen_from: View = "palm"


def _pose(
    catalog: str,
    description: str,
    seen_from: View,
    tags: tuple[str, ...],
    *angles: tuple[Degrees, ...],
) -> LibraryPose:
    """A row of the table.

    `angles` are flexions (MCP, PIP, DIP) of index, middle, ring and little finger; abductions of these four; flexion,
    abduction and twist of the thumb's CMC joint with the flexion of its MCP and IP joint.
    """
    *flexions, abductions, (flexion, abduction, twist, mcp, ip) = angles
    bends = {finger: (bend[0], bend[1], bend[2]) for finger, bend in zip(_FINGERS, flexions, strict=True)}
    thumb = ((flexion, abduction, twist), (mcp, 0, 0), (ip, 0, 0))
    gesture = Gesture(bends, dict(zip(_FINGERS, abductions, strict=True)), thumb)
    return LibraryPose(catalog, gesture, description, tags, seen_from)


def _grasp(description: str, tags: tuple[str, ...], *angles: tuple[Degrees, ...]) -> LibraryPose:
    return _pose("Grasps", description, "thumb", tags, *angles)


# fmt: off
POSES: dict[str, LibraryPose] = {
    "Open": LibraryPose("Basic", GESTURES["open"], "Open hand, fingers slightly apart"),
    "Spread": LibraryPose("Basic", GESTURES["spread"], "Fingers as far apart as they go", ("five",)),
    "Flat": _pose("Basic", "Straight fingers side by side", "palm", ("stop", "salute"),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (-3, 0, 3, 5), (4, 0, 0, -4, -10)),
    "Relaxed": LibraryPose("Basic", GESTURES["relaxed"], "A hand that does nothing", ("rest",), "thumb"),
    "Loose Fist": _pose("Basic", "Half-closed hand", "thumb", ("relaxed",),
        (52, 62, 32), (58, 66, 34), (62, 68, 35), (62, 66, 34), (0, 0, 0, 2), (7, -9, -8, 22, 8)),
    "Fist": _pose("Basic", "Closed fist, thumb outside", "palm", (),
        (74, 92, 62), (75, 92, 64), (75, 92, 64), (74, 90, 64), (2, 0, -1, 1), (12, -3, -6, 32, 52)),
    "Claw": _pose("Basic", "Spread fingers, bent at their middle joints", "palm", ("monster",),
        (-14, 52, 34), (-14, 52, 34), (-14, 52, 34), (-14, 52, 34), (7, 1, -5, -10), (-8, 0, 6, 8, 44)),
    "Point": _pose("Gestures", "Index finger straight", "palm", ("index", "there"),
        (-10, -11, -6), (75, 92, 64), (75, 92, 64), (74, 90, 64), (0, 0, -1, 1), (12, -3, -6, 32, 52)),
    "Thumbs Up": _pose("Gestures", "Thumb up", "palm", ("like", "good"),
        (74, 92, 62), (75, 92, 64), (75, 92, 64), (74, 90, 64), (2, 0, -1, 1), (-22, 0, 0, -10, -12)),
    "Finger Gun": _pose("Gestures", "Index straight, thumb up", "palm", ("L",),
        (-10, -11, -6), (75, 92, 64), (75, 92, 64), (74, 90, 64), (0, 0, -1, 1), (-22, 0, 0, -10, -12)),
    "Victory": _pose("Gestures", "Index and middle finger apart", "palm", ("peace", "V", "two"),
        (-10, -11, -6), (-10, -11, -6), (75, 92, 64), (74, 90, 64), (10, -7, -1, 1), (12, -3, -6, 32, 52)),
    "Horns": _pose("Gestures", "Index and little finger straight", "palm", ("rock",),
        (-10, -11, -6), (75, 92, 64), (75, 92, 64), (-10, -11, -6), (0, 0, -1, 0), (12, -3, -6, 32, 52)),
    "Call Me": _pose("Gestures", "Thumb and little finger out", "palm", ("shaka", "phone"),
        (74, 92, 62), (75, 92, 64), (75, 92, 64), (-10, -11, -6), (2, 0, -1, -12), (-22, 0, 0, -10, -12)),
    "I Love You": _pose("Gestures", "Thumb, index and little finger out", "palm", ("ILY", "sign"),
        (-10, -11, -6), (75, 92, 64), (75, 92, 64), (-10, -11, -6), (0, 0, -1, 0), (-22, 0, 0, -10, -12)),
    "Vulcan": _pose("Gestures", "Fingers parted in the middle", "palm", ("salute",),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (2, 9, -11, -5), (-16, 0, 0, -8, -12)),
    "Beckon": _pose("Gestures", "Index finger calls", "palm", ("come",),
        (20, 62, 40), (75, 92, 64), (75, 92, 64), (74, 90, 64), (2, 0, -1, 1), (12, -3, -6, 32, 52)),
    "OK": _pose("Gestures", "Ring of thumb and index finger", "thumb", ("good", "perfect"),
        (31, 50, 22), (10, 14, 6), (0, 6, 2), (-8, 0, 0), (-4, 0, -4, -8), (21, -6, 5, 9, 11)),
    "One": _pose("Counting", "One, from the index finger", "palm", ("1",),
        (-10, -11, -6), (75, 92, 64), (75, 92, 64), (74, 90, 64), (0, 0, -1, 1), (12, -3, -6, 32, 52)),
    "Two": _pose("Counting", "Two", "palm", ("2",),
        (-10, -11, -6), (-10, -11, -6), (75, 92, 64), (74, 90, 64), (6, -3, -1, 1), (12, -3, -6, 32, 52)),
    "Three": _pose("Counting", "Three, thumb on the little finger", "palm", ("3",),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (84, 44, 50), (7, 0, -6, 0), (42, -10, -8, 26, 46)),
    "Four": _pose("Counting", "Four, thumb in the palm", "palm", ("4",),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (7, 1, -5, -10), (34, -6, 14, 40, 40)),
    "Five": _pose("Counting", "Five", "palm", ("5",),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (8, 1, -6, -11), (-16, 0, 0, -8, -12)),
    "Large Diameter": _grasp("Round a jar (GRASP 1, Large Diameter)", ("power", "cylinder", "bottle"),
        (30, 38, 22), (32, 38, 22), (34, 38, 22), (36, 38, 22), (3, 0, -2, -4), (4, 0, 10, 10, 16)),
    "Small Diameter": _grasp("Round a rail (GRASP 2, Small Diameter)", ("power", "cylinder", "bar"),
        (64, 78, 42), (66, 78, 42), (68, 78, 42), (68, 76, 42), (2, 0, -1, 0), (17, 3, 0, 24, 24)),
    "Medium Wrap": _grasp("Round a handle (GRASP 3, Medium Wrap)", ("power", "cylinder", "hammer"),
        (52, 58, 30), (54, 58, 30), (56, 58, 30), (56, 56, 30), (1, 0, -1, -2), (18, 0, 10, 10, 14)),
    "Prismatic 4 Finger": _grasp("A pencil between thumb and four fingertips (GRASP 6, Prismatic 4 Finger)",
        ("precision",), (46, 29, 19), (48, 28, 21), (48, 28, 21), (46, 28, 20), (0, 0, 1, 3), (34, -11, 30, 5, 0)),
    "Palmar Pinch": _grasp("Pads of thumb and index finger (GRASP 9, Palmar Pinch)", ("precision", "pinch"),
        (31, 47, 34), (32, 30, 14), (26, 26, 12), (20, 22, 10), (-6, 0, 0, 0), (26, -12, 0, 2, 0)),
    "Power Disk": _grasp("Over a lid (GRASP 10, Power Disk)", ("power", "jar lid"),
        (4, 46, 30), (4, 46, 30), (4, 46, 30), (4, 46, 30), (11, 2, -9, -15), (-8, -6, 6, 4, 30)),
    "Power Sphere": _grasp("Round a ball, palm on it (GRASP 11, Power Sphere)", ("power", "ball", "apple"),
        (28, 38, 24), (30, 40, 25), (32, 40, 25), (34, 40, 25), (9, 2, -7, -14), (6, 0, 14, 10, 18)),
    "Precision Sphere": _grasp("Fingertips round a ball (GRASP 13, Precision Sphere)", ("precision", "ball"),
        (36, 36, 18), (40, 36, 18), (40, 36, 18), (40, 36, 18), (9, 2, -7, -14), (8, -6, 10, 4, 12)),
    "Tripod": _grasp("Thumb, index and middle finger (GRASP 14, Tripod)", ("precision",),
        (31, 28, 18), (37, 42, 29), (50, 54, 26), (50, 54, 26), (-4, 0, 0, 0), (26, -16, 18, 2, 0)),
    "Fixed Hook": _grasp("A bag hangs from the fingers (GRASP 15, Fixed Hook)", ("hook", "carry"),
        (2, 78, 45), (2, 78, 45), (2, 78, 45), (2, 78, 45), (0, 0, 0, 2), (4, 0, 8, 12, 20)),
    "Lateral": _grasp("Thumb on the side of the index finger (GRASP 16, Lateral)", ("key", "card"),
        (47, 63, 34), (58, 72, 40), (62, 74, 40), (62, 72, 40), (7, 0, 0, 0), (7, -11, -8, 12, 10)),
    "Index Finger Extension": _grasp("A knife, index finger along it (GRASP 17, Index Finger Extension)", ("knife",),
        (18, 10, 4), (62, 72, 38), (64, 72, 38), (64, 70, 38), (0, 0, 0, 0), (33, -8, -8, 1, 9)),
    "Writing Tripod": _grasp("A pen (GRASP 20, Writing Tripod)", ("pen", "write", "precision"),
        (33, 39, 21), (50, 52, 24), (54, 62, 30), (54, 62, 30), (-2, 1, 1, 2), (22, -11, 7, 4, 0)),
    "Parallel Extension": _grasp("Straight fingers, a book (GRASP 22, Parallel Extension)", ("book", "flat"),
        (58, -6, -4), (58, -6, -4), (58, -6, -4), (58, -6, -4), (1, 0, -1, -2), (40, 0, 0, -10, -10)),
    "Tip Pinch": _grasp("Tips of thumb and index finger (GRASP 24, Tip Pinch)", ("precision", "needle"),
        (32, 48, 32), (36, 40, 20), (34, 40, 20), (32, 38, 18), (-3, 0, 0, 0), (20, -8, 8, 6, 20)),
}
# fmt: on
