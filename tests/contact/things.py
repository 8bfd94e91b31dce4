"""Ten things of our own, made by code, and twenty grasps of them: which pose, and where the thing lies in the hand.

Lengths in metres, in the space of a right hand: fingers towards -X, palm towards -Y, thumb towards +Z.
"""

from typing import NamedTuple

import numpy as np
import trimesh
from livehand.backend.contact.contact_hand import PALM, ContactHand
from livehand.backend.contact.placed_solids import PlacedSolid
from livehand.backend.hand.gestures import FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.poses import POSES
from livehand.backend.records.shot import HandPose

_TIPS = {"thumb": 15, "index": 3, "middle": 6, "ring": 12}
_GAP_M = 0.0005  # between the palm and what lies in it


def revolved(profile, sections=48):
    """A closed solid of revolution about Z of a profile [K, 2] of radii and heights, which begins and ends on it."""
    mesh = trimesh.creation.revolve(np.asarray(profile, float), sections=sections)
    mesh.merge_vertices()
    return mesh


def sphere():
    return trimesh.creation.icosphere(4, 0.034)


def cylinder():
    return trimesh.creation.cylinder(0.022, 0.16, sections=64)


def box():
    return trimesh.creation.box((0.045, 0.055, 0.09))


def cone():
    return revolved([(0, 0), (0.034, 0), (0.034, 0.004), (0.004, 0.09), (0, 0.092)]).apply_translation((0, 0, -0.046))


def torus():
    return trimesh.creation.torus(0.045, 0.009, major_sections=64, minor_sections=24)


def bottle():
    half = [(0, 0), (0.03, 0), (0.033, 0.004), (0.033, 0.08), (0.028, 0.095), (0.014, 0.115), (0.013, 0.21), (0, 0.21)]
    return revolved(half).apply_translation((0, 0, -0.05))


def handle():
    """A bar between two posts on a plate: parts that pass through each other."""
    bar = trimesh.creation.capsule(0.1, 0.011, count=[24, 24])
    posts = [
        trimesh.creation.cylinder(
            0.008, 0.05, sections=24, transform=trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0))
        ).apply_translation((0, -0.025, end))
        for end in (-0.05, 0.05)
    ]
    plate = trimesh.creation.box((0.03, 0.006, 0.15)).apply_translation((0, -0.052, 0))
    bar.apply_translation((0, 0, -bar.centroid[2]))
    return trimesh.util.concatenate([bar, *posts, plate])


def phone():
    return trimesh.creation.box((0.146, 0.008, 0.072))


def pen():
    half = [(0, 0), (0.001, 0.0), (0.0045, 0.02), (0.0045, 0.138), (0.003, 0.142), (0, 0.142)]
    return revolved(half, 24).apply_translation((0, 0, -0.03))


def egg():
    angle = np.linspace(0, np.pi, 33)
    radius = 0.022 * np.sin(angle) * (1 - 0.12 * np.cos(angle))
    radius[[0, -1]] = 0
    return revolved(np.stack([radius, -0.029 * np.cos(angle)], 1))


class Hold(NamedTuple):
    """A grasp: the thing, the library's pose, how the thing is turned (degrees about X, Y, Z in turn), and its place.

    `at` is "palm" or a tuple of fingers, between whose pads and the thumb's it lies; `offset_mm` goes on from there.
    `opened_deg` is taken from all flexions of the pose.
    """

    thing: str
    pose: str
    turn_deg: tuple = (0, 0, 0)
    at: object = "palm"
    offset_mm: tuple = (0, 0, 0)
    opened_deg: float = 0.0


THINGS = {make.__name__: make for make in (sphere, cylinder, box, cone, torus, bottle, handle, phone, pen, egg)}
HOLDS = (
    Hold("sphere", "Power Sphere", offset_mm=(-12, 0, 4)),
    Hold("sphere", "Precision Sphere", at=("index", "middle")),
    Hold("cylinder", "Medium Wrap", (0, 8, 0), offset_mm=(-14, 0, 0)),
    Hold("cylinder", "Open", (0, 15, 0), offset_mm=(-12, 0, 0)),
    Hold("box", "Large Diameter", offset_mm=(-14, 0, 0)),
    Hold("box", "Power Disk", (0, 0, 90), offset_mm=(-16, 0, 10)),
    Hold("cone", "Power Disk", offset_mm=(-12, 0, 5)),
    Hold("cone", "Tripod", (0, 0, 0), at=("index", "middle"), offset_mm=(0, 0, -20)),
    Hold("torus", "Fixed Hook", (90, 0, 0), offset_mm=(-48, 0, 0)),
    Hold("torus", "Palmar Pinch", (90, 0, 0), at=("index",), offset_mm=(-45, 0, 0), opened_deg=5),
    Hold("bottle", "Large Diameter", (0, 5, 0), offset_mm=(-14, 0, 0)),
    Hold("bottle", "Small Diameter", (180, 8, 0), offset_mm=(-16, 0, 112)),
    Hold("handle", "Medium Wrap", (0, 8, 0), offset_mm=(-22, 0, 0)),
    Hold("handle", "Fixed Hook", (0, 0, 0), offset_mm=(-40, 0, 0)),
    Hold("phone", "Relaxed", (0, 90, 0), offset_mm=(-10, 0, 20)),
    Hold("phone", "Palmar Pinch", at=("index", "middle"), offset_mm=(-60, 0, 0)),
    Hold("pen", "Writing Tripod", (-60, 60, 0), at=("index", "middle")),
    Hold("pen", "Tip Pinch", (0, -60, 0), at=("index",)),
    Hold("egg", "Tripod", (90, 0, 0), at=("index", "middle"), opened_deg=10),
    Hold("egg", "Power Sphere", offset_mm=(-14, 0, 0)),
)


def given_pose(hold, side="right"):
    """The pose that an animator would start from."""
    angles = POSES[hold.pose].gesture.angles_deg()
    angles[:, 0] -= hold.opened_deg
    pose = HandPose(theta_of(angles, FingerAxes.of_default_hand()), np.zeros(10), np.zeros(3))
    return pose if side == "right" else pose.mirrored()


def between(thumb, fingers):
    """The matrix [4, 4] that takes Y to the way from the thumb to the fingers, about the middle of both."""
    up = (fingers - thumb) / np.linalg.norm(fingers - thumb)
    across = np.cross((1, 0, 0), up)
    across /= np.linalg.norm(across)
    matrix = np.eye(4)
    matrix[:3] = np.stack([np.cross(up, across), up, across, (thumb + fingers) / 2], 1)
    return matrix


def placed_mesh(hold, hand):
    """The thing of a hold, in the space of the right hand."""
    mesh = THINGS[hold.thing]()
    for axis, angle in zip(np.eye(3), np.deg2rad(hold.turn_deg), strict=True):
        mesh.apply_transform(trimesh.transformations.rotation_matrix(angle, axis))
    vertices = posed_vertices(hand, given_pose(hold))
    joint = hand.lbs_weights.argmax(1)
    if hold.at != "palm":
        tips = {name: vertices[joint == number].mean(0) for name, number in _TIPS.items()}
        fingers = np.mean([tips[name] for name in hold.at], 0)
        mesh.apply_translation(np.array(hold.offset_mm) / 1000)
        mesh.apply_transform(between(tips["thumb"], fingers))
        return mesh
    touching = ContactHand.of(hand, np.zeros(10))
    palm = touching.points(vertices[touching.vertices])[touching.digit == PALM]
    mesh.apply_translation(np.array(hold.offset_mm) / 1000 + (palm.mean(0) * (1, 0, 0)))
    mesh.apply_translation((0, palm[:, 1].min() - 0.05 - mesh.bounds[1, 1], 0))
    solid = PlacedSolid.of(mesh.vertices, mesh.faces)
    for _ in range(60):
        gap = solid.distances(palm - (0, mesh.metadata.get("raised", 0.0), 0)).signed_m.min() - _GAP_M
        mesh.metadata["raised"] = mesh.metadata.get("raised", 0.0) + gap
    return mesh.apply_translation((0, mesh.metadata["raised"], 0))
