"""The pose library: named hand poses as joint angles, for Blender's pose assets; and random mixes for captures.

Angles are those of `gestures`: degrees from the built-in hand's rest pose, in which a finger is bent by about 11 (MCP),
12 (PIP) and 7 (DIP). Grasps are named and numbered after Feix, Romero, Schmiedmayer, Dollar and Kragic 2016, "The GRASP
Taxonomy of Human Grasp Types". In pinches, thumb and finger were fitted so that they touch.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from .gestures import GESTURES, Degrees, Gesture, sample_angles_deg

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
        view_from: the side from which its preview is rendered.
    """

    catalog: str
    gesture: Gesture
    description: str
    tags: tuple[str, ...] = ()
    view_from: View = "palm"


def _pose(
    catalog: str,
    description: str,
    view_from: View,
    tags: tuple[str, ...],
    *angles: tuple[Degrees, ...],
) -> LibraryPose:
    """Build a row of the table.

    `angles` are flexions (MCP, PIP, DIP) of index, middle, ring and little finger; abductions of these four; flexion,
    abduction and twist of the thumb's CMC joint with the flexion of its MCP and IP joint.
    """
    *flexions, abductions, (flexion, abduction, twist, mcp, ip) = angles
    bends = {finger: (bend[0], bend[1], bend[2]) for finger, bend in zip(_FINGERS, flexions, strict=True)}
    thumb = ((flexion, abduction, twist), (mcp, 0, 0), (ip, 0, 0))
    gesture = Gesture(bends, dict(zip(_FINGERS, abductions, strict=True)), thumb)
    return LibraryPose(catalog, gesture, description, tags, view_from)


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
        (53, 62, 32), (57, 66, 35), (62, 67, 35), (60, 66, 33), (1, 2, -3, 1), (5, -9, -8, 22, 8)),
    "Fist": _pose("Basic", "Closed fist, thumb outside", "palm", (),
        (74, 99, 38), (87, 85, 59), (72, 92, 74), (72, 84, 61), (8, 7, 2, -5), (31, 3, -18, 5, 45)),
    "Claw": _pose("Basic", "Spread fingers, bent at their middle joints", "palm", ("monster",),
        (-14, 52, 34), (-14, 52, 34), (-14, 52, 34), (-14, 52, 34), (7, 1, -5, -10), (-8, 0, 6, 8, 44)),
    "Point": _pose("Gestures", "Index finger straight", "palm", ("index", "there"),
        (-10, -11, -6), (74, 90, 63), (68, 89, 63), (69, 87, 59), (0, 6, 2, -1), (9, -2, -5, 31, 53)),
    "Thumbs Up": _pose("Gestures", "Thumb up", "palm", ("like", "good"),
        (78, 91, 61), (77, 91, 64), (67, 89, 64), (68, 88, 58), (3, 3, 1, -1), (-22, 0, 0, -10, -12)),
    "Finger Gun": _pose("Gestures", "Index straight, thumb up", "palm", ("L",),
        (-10, -11, -6), (71, 92, 65), (67, 88, 63), (69, 87, 60), (0, 6, 0, -2), (-22, 0, 0, -10, -12)),
    "Victory": _pose("Gestures", "Index and middle finger apart", "palm", ("peace", "V", "two"),
        (-10, -11, -6), (-10, -11, -6), (68, 89, 64), (69, 87, 60), (10, -7, 2, -1), (12, -3, -6, 32, 52)),
    "Horns": _pose("Gestures", "Index and little finger straight", "palm", ("rock",),
        (-10, -11, -6), (76, 92, 64), (73, 93, 65), (-10, -11, -6), (0, 2, -3, 0), (10, -2, -6, 33, 54)),
    "Call Me": _pose("Gestures", "Thumb and little finger out", "palm", ("shaka", "phone"),
        (76, 92, 62), (76, 93, 64), (73, 93, 65), (-10, -11, -6), (2, 2, -4, -12), (-22, 0, 0, -10, -12)),
    "I Love You": _pose("Gestures", "Thumb, index and little finger out", "palm", ("ILY", "sign"),
        (-10, -11, -6), (77, 92, 64), (74, 93, 65), (-10, -11, -6), (0, 2, -3, 0), (-22, 0, 0, -10, -12)),
    "Vulcan": _pose("Gestures", "Fingers parted in the middle", "palm", ("salute",),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (2, 9, -11, -5), (-16, 0, 0, -8, -12)),
    "Beckon": _pose("Gestures", "Index finger calls", "palm", ("come",),
        (20, 62, 40), (74, 90, 63), (68, 89, 63), (69, 87, 59), (2, 6, 2, -1), (9, -2, -5, 31, 53)),
    "OK": _pose("Gestures", "Ring of thumb and index finger", "thumb", ("good", "perfect"),
        (27, 50, 29), (10, 14, 6), (0, 6, 2), (-8, 0, 0), (-4, 0, -4, -8), (20, -6, -3, 9, 10)),
    "One": _pose("Counting", "One, from the index finger", "palm", ("1",),
        (-10, -11, -6), (74, 90, 63), (68, 89, 63), (69, 87, 59), (0, 6, 2, -1), (9, -2, -5, 31, 53)),
    "Two": _pose("Counting", "Two", "palm", ("2",),
        (-10, -11, -6), (-10, -11, -6), (68, 89, 64), (69, 87, 60), (6, -3, 2, -1), (12, -3, -6, 32, 52)),
    "Three": _pose("Counting", "Three, thumb on the little finger", "palm", ("3",),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (84, 44, 50), (7, 0, -6, -6), (45, -8, -8, 14, 42)),
    "Four": _pose("Counting", "Four, thumb in the palm", "palm", ("4",),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (7, 1, -5, -10), (34, -6, 14, 40, 40)),
    "Five": _pose("Counting", "Five", "palm", ("5",),
        (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (-10, -11, -6), (8, 1, -6, -11), (-16, 0, 0, -8, -12)),
    "Large Diameter": _grasp("Round a jar (GRASP 1, Large Diameter)", ("power", "cylinder", "bottle"),
        (30, 38, 22), (32, 38, 22), (34, 38, 22), (36, 38, 22), (3, 0, -2, -4), (4, 0, 10, 10, 16)),
    "Small Diameter": _grasp("Round a rail (GRASP 2, Small Diameter)", ("power", "cylinder", "bar"),
        (67, 78, 42), (65, 78, 41), (68, 76, 43), (63, 77, 38), (5, 4, -1, -2), (15, 3, 2, 22, 23)),
    "Medium Wrap": _grasp("Round a handle (GRASP 3, Medium Wrap)", ("power", "cylinder", "hammer"),
        (57, 59, 30), (51, 58, 31), (58, 58, 30), (56, 56, 30), (0, 1, -2, -2), (17, 0, 14, 10, 15)),
    "Prismatic 4 Finger": _grasp("A pencil between thumb and four fingertips (GRASP 6, Prismatic 4 Finger)",
        ("precision",), (46, 29, 19), (48, 28, 21), (48, 28, 21), (46, 28, 20), (0, 0, 1, 3), (16, -11, 30, 5, 0)),
    "Palmar Pinch": _grasp("Pads of thumb and index finger (GRASP 9, Palmar Pinch)", ("precision", "pinch"),
        (28, 47, 32), (32, 30, 14), (26, 26, 12), (20, 22, 10), (-5, 0, 0, 0), (22, -12, -2, 4, 4)),
    "Power Disk": _grasp("Over a lid (GRASP 10, Power Disk)", ("power", "jar lid"),
        (4, 46, 30), (4, 46, 30), (4, 46, 30), (4, 46, 30), (11, 2, -9, -15), (-8, -6, 6, 4, 30)),
    "Power Sphere": _grasp("Round a ball, palm on it (GRASP 11, Power Sphere)", ("power", "ball", "apple"),
        (28, 38, 24), (30, 40, 25), (32, 40, 25), (34, 40, 25), (9, 2, -7, -14), (6, 0, 14, 10, 18)),
    "Precision Sphere": _grasp("Fingertips round a ball (GRASP 13, Precision Sphere)", ("precision", "ball"),
        (36, 36, 18), (40, 36, 18), (40, 36, 18), (40, 36, 18), (9, 2, -7, -14), (8, -6, 10, 4, 12)),
    "Tripod": _grasp("Thumb, index and middle finger (GRASP 14, Tripod)", ("precision",),
        (31, 28, 18), (37, 42, 29), (50, 54, 26), (50, 54, 26), (-4, 0, 0, 0), (19, -16, 18, 2, 0)),
    "Fixed Hook": _grasp("A bag hangs from the fingers (GRASP 15, Fixed Hook)", ("hook", "carry"),
        (2, 78, 45), (2, 78, 45), (2, 78, 45), (2, 78, 45), (0, 0, 0, 2), (4, 0, 8, 12, 20)),
    "Lateral": _grasp("Thumb on the side of the index finger (GRASP 16, Lateral)", ("key", "card"),
        (44, 62, 34), (55, 72, 40), (65, 74, 40), (61, 72, 40), (5, 3, -1, -2), (8, -12, -6, 10, 6)),
    "Index Finger Extension": _grasp("A knife, index finger along it (GRASP 17, Index Finger Extension)", ("knife",),
        (18, 10, 4), (61, 72, 38), (67, 71, 37), (61, 70, 38), (0, 4, -1, -1), (31, -8, -16, -2, 5)),
    "Writing Tripod": _grasp("A pen (GRASP 20, Writing Tripod)", ("pen", "write", "precision"),
        (32, 39, 22), (50, 52, 24), (54, 62, 30), (54, 62, 30), (-3, 1, 1, 2), (23, -11, 8, 3, -2)),
    "Parallel Extension": _grasp("Straight fingers, a book (GRASP 22, Parallel Extension)", ("book", "flat"),
        (58, -6, -4), (58, -6, -4), (58, -6, -4), (58, -6, -4), (1, 0, -1, -2), (40, 0, 0, -10, -10)),
    "Tip Pinch": _grasp("Tips of thumb and index finger (GRASP 24, Tip Pinch)", ("precision", "needle"),
        (28, 48, 38), (36, 40, 20), (34, 40, 20), (32, 38, 18), (-4, 0, 0, 0), (19, -7, 0, 5, 18)),
}
# fmt: on


LIBRARY_SHARE = 0.4
"""Of the poses that are the library's: fists, pinches and grasps, which mixes of gestures hardly reach."""
_NOISE_DEG = np.array([3.0, 1.5, 1.0])  # of flexion, abduction and twist


def sample_poses_deg(rng: np.random.Generator, count: int) -> np.ndarray:
    """Draw [count, 15, 3] joint angles, degrees from the built-in hand's rest pose; parts may cross a little."""
    library = [pose.gesture.angles_deg() for pose in POSES.values()]
    angles = sample_angles_deg(rng, count)
    for k in np.flatnonzero(rng.random(count) < LIBRARY_SHARE):
        angles[k] = library[rng.integers(len(library))] + rng.normal(size=(15, 3)) * _NOISE_DEG
    return angles
