"""`livehand lookdev`: where its cameras look and its lamp stands, and a small run."""

import json
from functools import partial

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.posed_bones import bone_frames
from livehand.backend.teacher.detailed_surface import detailed_surface
from livehand.livehand_blender.capture import render as capture_render
from livehand.livehand_blender.capture.bake import bake_skin
from livehand.livehand_blender.capture.scene import capture_scene
from livehand.livehand_blender.cli import main
from livehand.tools.lookdev import sheets
from livehand.tools.lookdev.views import CLOSE_UPS, WHOLE_HANDS, KeyLight, aim


@pytest.fixture(scope="module")
def right_hand():
    return load_default_hand()


def projected_px(aim, point):
    in_camera = np.linalg.inv(aim.camera.cam2world) @ [*point, 1]
    return (aim.camera.K @ in_camera[:3])[:2] / in_camera[2]


@pytest.mark.parametrize("view", [*WHOLE_HANDS.values(), *CLOSE_UPS.values()])
def test_a_view_looks_at_its_joint_at_its_scale(view, right_hand):
    at = aim(view, right_hand, np.zeros(10), 200)
    np.testing.assert_allclose(projected_px(at, at.subject_m), (100, 100), atol=1e-6)
    joint = bone_frames(right_hand, at.pose)[view.joint, :3, 3]
    assert np.linalg.norm(1000 * (at.subject_m - joint)) == pytest.approx(np.linalg.norm(view.offset_mm))
    right = at.camera.cam2world[:3, 0]
    step = projected_px(at, at.subject_m + 0.001 * right) - (100, 100)
    np.testing.assert_allclose(step, (1 / view.mm_per_px, 0), atol=1e-6)


def test_fingers_of_the_open_hand_point_up_and_the_back_shows_the_thumb_on_the_right(right_hand):
    at = aim(WHOLE_HANDS["open, back"], right_hand, np.zeros(10), 200)
    joints = bone_frames(right_hand, at.pose)[:, :3, 3]
    wrist, tip, thumb = (projected_px(at, joints[k]) for k in (0, 6, 15))
    assert tip[1] < wrist[1] - 50  # rows count downwards
    side = projected_px(aim(WHOLE_HANDS["open, palm"], right_hand, np.zeros(10), 200), joints[15])[0]
    assert (thumb[0] - wrist[0]) * (side - wrist[0]) < 0


def test_the_lamp_stands_off_the_view_and_shines_on_the_subject(right_hand):
    light = KeyLight(capture_scene())
    at = aim(CLOSE_UPS["nail"], right_hand, np.zeros(10), 200)
    light.follow(at)
    lamp = np.array(bpy.data.objects["key"].matrix_world)
    to_lamp = lamp[:3, 3] - at.subject_m
    assert np.linalg.norm(to_lamp) == pytest.approx(0.9, abs=1e-5)
    np.testing.assert_allclose(lamp[:3, 2], to_lamp / 0.9, atol=1e-5)  # it shines along -Z
    angle_deg = np.rad2deg(np.arccos(to_lamp @ at.towards / 0.9))
    assert angle_deg == pytest.approx(55, abs=0.1)
    assert to_lamp @ at.camera.cam2world[:3, 0] < 0  # from the left
    assert to_lamp @ at.camera.cam2world[:3, 1] < 0  # from above
    np.testing.assert_allclose(lamp[:3, :3].T @ lamp[:3, :3], np.eye(3), atol=1e-5)


@pytest.mark.nightly
def test_a_small_run_writes_sheets_and_figures(right_hand, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(capture_render, "detailed_surface", lambda model: detailed_surface(model, levels=1))
    monkeypatch.setattr(capture_render, "bake_skin", partial(bake_skin, size_px=256))
    monkeypatch.setattr(sheets, "WHOLE_HANDS", {name: WHOLE_HANDS[name] for name in ("open, back", "open, palm")})
    monkeypatch.setattr(sheets, "CLOSE_UPS", {"nail": CLOSE_UPS["nail"]})
    monkeypatch.setattr(sheets, "_WHOLE_PX", 240)
    monkeypatch.setitem(sheets._POINTS_OF_COLOUR, "elbow", (True, 3.0, (0,), (-900.0, 0.0, 0.0)))
    assert main(["lookdev", "-o", str(tmp_path), "--size", "32", "--samples", "2"]) == 0
    out = capsys.readouterr().out
    assert "albedo, Lab: back" in out
    assert "elbow: not seen" in out
    assert "nan" not in out.split("albedo")[1]
    assert {path.name for path in tmp_path.iterdir()} == {"whole_hands.png", "close_ups.png", "figures.json"}
    figures = json.loads((tmp_path / "figures.json").read_text())
    back, palm = (np.array(figures["lab"][place]) for place in ("back", "palm"))
    assert palm[0] > back[0] + 4  # of light skin
    assert 55 < back[0] < 80
    assert "elbow" not in figures["lab"]
    assert set(figures["contrast"]) == {"open, back", "open, palm"}
