"""Leap Motion's and Rokoko's own files hold all joints: bones with two ends, JavaScript's pointables, bodies' bones."""

import json
from itertools import pairwise

import numpy as np
import pytest
from livehand.backend.motion.files.open_files import open_motion_file
from livehand.tests.motion.landmarks.test_landmark_file import closing_landmarks

pytestmark = pytest.mark.slow

POINTS = 1000 * closing_landmarks() + [20.0, 200, 30]  # mm
NAMES = ("Thumb", "Index", "Middle", "Ring", "Little")


def read(path, content):
    path.write_text(json.dumps(content))
    return open_motion_file(path)


def bones(chain, wrist, spell):
    """The four bones of a finger whose three joints and tip are chain [4, 3]."""
    ends = [wrist, *chain]
    return [{"prev_joint": spell(a), "next_joint": spell(b)} for a, b in pairwise(ends)]


def as_named(point):
    return dict(zip("xyz", point.tolist(), strict=True))


@pytest.mark.parametrize("spell", [as_named, np.ndarray.tolist])
def test_leaps_bones(tmp_path, spell):
    def hand(points):
        fingers = [bones(points[1 + 4 * k : 5 + 4 * k], points[0], spell) for k in range(5)]
        return {"type": "right", "digits": [{"type": k, "bones": each} for k, each in enumerate(fingers)]}

    file = read(tmp_path / "leap.json", {"frames": [{"hands": [hand(points)]} for points in POINTS]})
    np.testing.assert_allclose(file.points, POINTS)
    assert (file.info.side, file.info.unit, file.info.space) == ("right", "mm", "y_up")


def test_leaps_pointables(tmp_path):
    keys = ("mcpPosition", "pipPosition", "dipPosition", "btipPosition")

    def frame(points):
        fingers = [
            {"handId": 7, "type": k, "carpPosition": points[0].tolist()}
            | dict(zip(keys, points[1 + 4 * k : 5 + 4 * k].tolist(), strict=True))
            for k in (3, 0, 1, 2, 4)
        ]
        return {"hands": [{"id": 7, "type": "right", "wrist": points[0].tolist()}], "pointables": fingers}

    file = read(tmp_path / "leap.json", [frame(points) for points in POINTS] + [{"hands": [], "pointables": []}])
    np.testing.assert_allclose(file.points, POINTS)
    assert file.info.side == "right"


@pytest.mark.slow
def test_rokokos_bodies_in_left_handed_axes(tmp_path):
    parts = ("Proximal", "Medial", "Distal", "Tip")
    names = ["Hand", *(finger + part for finger in NAMES for part in parts)]

    def body(points):
        both = {"right": points, "left": points * [-1, 1, 1]}
        return {
            side + name: {"position": as_named(point * [1, 1, -1] / 1000), "rotation": {"x": 0, "y": 0, "z": 0, "w": 1}}
            for side, of_side in both.items()
            for name, point in zip(names, of_side, strict=True)
        } | {"hip": {"position": {"x": 0, "y": 1, "z": 0}}}

    frames = [{"scene": {"timestamp": 0.0, "actors": [{"name": "A", "body": body(points)}]}} for points in POINTS]
    file = read(tmp_path / "rokoko.json", frames)
    np.testing.assert_allclose(file.with_changes(side="right").points, POINTS / 1000)
    np.testing.assert_allclose(file.with_changes(side="left").points, POINTS * [-1, 1, 1] / 1000)


def test_leaps_columns(tmp_path):
    columns, values = ["frame", "hand_type"], [np.arange(3), ["right"] * 3]
    for place, (bone, end) in enumerate(
        (("proximal", "prev"), ("intermediate", "prev"), ("distal", "prev"), ("distal", "next"))
    ):
        for finger, name in enumerate(NAMES):
            for axis, letter in enumerate("xyz"):
                columns.append(f"{name.lower()}_{bone}_{end}_joint_{letter}")
                values.append(POINTS[:, 1 + 4 * finger + place, axis])
    for axis, letter in enumerate("xyz"):
        columns.append(f"wrist_position_{letter}")
        values.append(POINTS[:, 0, axis])
        columns.append(f"palm_velocity_{letter}")
        values.append(np.zeros(3))
    rows = [",".join(map(str, row)) for row in zip(*values, strict=True)]
    path = tmp_path / "leap.csv"
    path.write_text("\n".join([",".join(columns), *rows]))
    file = open_motion_file(path)
    np.testing.assert_allclose(file.points, POINTS)
    assert (file.info.side, file.info.unit) == ("right", "mm")
