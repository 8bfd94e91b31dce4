"""The anatomical tables: bone lengths, positions and thicknesses of the rays. Millimetres, anatomical frame, degrees.

Sources: bone lengths after Buryanov & Kotiuk 2010 (doi 10.4067/S0717-95022010000300015), quoted from
memory. Breadths, depths and palm sections are tuned by eye within remembered ranges of Greiner 1991 and DIN 33402,
unverified. The layout of the rays (points, directions, rest flexion) is tuned by eye. Checked: finger lengths against
Chatzioglou 2024, 63.9 / 70.7 / 65.5 / 53.3 mm; ours are 59.9 / 68.0 / 65.6 / 52.2, all within one standard deviation.
"""

from __future__ import annotations

from dataclasses import dataclass

from ..hand.model import MANO_FINGERS

Point = tuple[float, float, float]

# Joint 1 + 3 * i + k is joint k of digit i.
DIGITS = MANO_FINGERS
# From the radial to the ulnar side.
FINGERS = ("index", "middle", "ring", "pinky")


@dataclass(frozen=True)
class BoneLengths:
    """Lengths of a digit's bones and of the soft tip beyond the last one. The thumb's middle phalanx is 0."""

    metacarpal: float
    proximal: float
    middle: float
    distal: float
    tip: float

    @property
    def phalanges(self) -> tuple[float, ...]:
        """Lengths from the metacarpal's head to the end of the last bone."""
        return tuple(length for length in (self.proximal, self.middle, self.distal) if length > 0)


@dataclass(frozen=True)
class FingerLayout:
    """The position of a finger.

    Attributes:
        mcp: its first joint.
        metacarpal_base: the other end of the metacarpal. The surface uses the distance of the two points, not the
            metacarpal length of the table.
        abduction: of the finger's direction, positive towards the thumb.
        tilt: of its dorsal direction, positive towards the thumb.
        rest_flexion: of the three joints.
    """

    mcp: Point
    metacarpal_base: Point
    abduction: float
    tilt: float
    rest_flexion: Point


@dataclass(frozen=True)
class ThumbLayout:
    """The position of the thumb: its first joint, the directions of its three bones, and its dorsal direction."""

    cmc: Point
    directions: tuple[Point, Point, Point]
    dorsal: Point


@dataclass(frozen=True)
class Profile:
    """Half-sizes of a digit's cross-section at the stations of `rays.py`."""

    half_breadth: tuple[float, ...]
    dorsal_depth: tuple[float, ...]
    palmar_depth: tuple[float, ...]

    def scaled(self, factor: float) -> Profile:
        """Scale the profile of a digit to be `factor` times as thick."""
        rows = (self.half_breadth, self.dorsal_depth, self.palmar_depth)
        return Profile(*(tuple(value * factor for value in row) for row in rows))


BONES = {
    "thumb": BoneLengths(46.22, 31.57, 0.0, 21.67, 5.67),
    "index": BoneLengths(68.12, 39.78, 22.38, 15.82, 3.84),
    "middle": BoneLengths(64.60, 44.63, 26.33, 17.40, 3.95),
    "ring": BoneLengths(58.00, 41.37, 25.65, 17.30, 3.95),
    "pinky": BoneLengths(53.69, 32.74, 18.11, 15.96, 3.73),
}

FINGER_LAYOUTS = {
    "index": FingerLayout((92.0, 1.5, 25.5), (27.0, 0.5, 12.0), 6.0, 8.0, (9.0, 11.0, 6.0)),
    "middle": FingerLayout((94.5, 3.5, 4.5), (30.0, 2.0, 2.0), 0.0, 1.0, (9.0, 12.0, 7.0)),
    "ring": FingerLayout((88.0, 2.0, -14.5), (28.0, 1.0, -8.0), -7.5, -7.0, (10.0, 13.0, 7.0)),
    "pinky": FingerLayout((77.5, -2.0, -31.0), (25.0, -2.0, -17.0), -18.0, -15.0, (11.0, 13.0, 8.0)),
}

THUMB_LAYOUT = ThumbLayout(
    cmc=(21.0, -8.0, 23.0),
    directions=((0.70, -0.42, 0.58), (0.835, -0.34, 0.43), (0.885, -0.32, 0.335)),
    dorsal=(-0.30, 0.50, 0.81),
)

# Relative to the index finger.
FINGER_THICKNESS = {"index": 1.0, "middle": 1.03, "ring": 0.965, "pinky": 0.85}

# Stations: metacarpal base, its middle, MCP, web, 3/4 of the proximal phalanx, PIP, middle of the middle phalanx, DIP,
# middle of the distal phalanx, end of the nail.
_INDEX_PROFILE = Profile(
    half_breadth=(8.5, 10.0, 11.2, 9.9, 9.1, 9.75, 8.5, 8.35, 7.75, 6.3),
    dorsal_depth=(9.0, 10.0, 11.2, 8.6, 7.7, 8.2, 7.0, 6.4, 5.6, 4.3),
    palmar_depth=(9.0, 10.0, 11.5, 10.6, 9.7, 9.0, 9.0, 7.6, 7.9, 5.8),
)
# Stations: metacarpal base, its middle, MCP, 1/2 and 3/4 of the proximal phalanx, IP, 0.35 of the distal phalanx, its
# middle, end of the nail.
_THUMB_PROFILE = Profile(
    half_breadth=(10.5, 10.5, 11.6, 10.0, 9.8, 11.0, 10.6, 10.4, 8.2),
    dorsal_depth=(10.5, 9.0, 10.8, 7.9, 7.7, 8.4, 6.9, 6.2, 4.6),
    palmar_depth=(12.0, 12.0, 11.0, 10.0, 9.4, 8.9, 8.8, 8.6, 6.4),
)


def profile(digit: str) -> Profile:
    """Look up the cross-sections of a digit."""
    if digit == "thumb":
        return _THUMB_PROFILE
    return _INDEX_PROFILE.scaled(FINGER_THICKNESS[digit])
