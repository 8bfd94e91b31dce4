"""A scene's hands as splats: the command, the operator, and the skin of exports from the menu."""

import json
import struct

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender import cli
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand

FEW = {"count": 2000, "views": 12, "size_px": 128}


@pytest.fixture
def scene(registered):
    bpy.ops.livehand.new_hand_scene()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end, scene.frame_current = 3, 4, 3
    (hand,) = RiggedHand.all_in(scene)
    hand.armature.location = (0.2, 0, 1)
    bpy.context.view_layer.objects.active = hand.armature
    return scene


def columns(path):
    head, data = path.read_bytes().split(b"end_header\n", 1)
    names = [line.split()[-1].decode() for line in head.splitlines() if line.startswith(b"property float")]
    return dict(zip(names, np.frombuffer(data, "<f4").reshape(-1, len(names)).T, strict=True))


@pytest.mark.nightly
def test_a_scene_is_fitted_in_its_own_light(scene, tmp_path, capsys):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    words = ["export", str(tmp_path / "shot.blend"), "--frames", "3", "--json"]
    few = ["--splats", "2000", "--views", "12", "--view-size", "128"]
    assert cli.main([*words, "-o", str(tmp_path / "lit.ply"), *few]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["held_out_db"][0] > 22
    for lamp in bpy.data.lights:
        lamp.energy *= 0.05
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "shot.blend"))
    assert cli.main([*words, "-o", str(tmp_path / "dark.ply"), *few]) == 0
    lit, dark = columns(tmp_path / "lit.ply"), columns(tmp_path / "dark.ply")
    assert dark["f_dc_0"].mean() < lit["f_dc_0"].mean() - 0.3
    np.testing.assert_allclose(lit["x"], dark["x"])
    assert -1.3 < np.median(lit["y"]) < -0.9  # Y down: the hand is a metre above the floor
    assert cli.main([*words, "-o", str(tmp_path / "no.ply"), "--avatar", "deep"]) == 1
    assert "--avatar is of a file of poses" in capsys.readouterr().err


@pytest.mark.nightly
def test_the_operator_writes_the_active_hand_or_all(scene, tmp_path):
    first = bpy.context.view_layer.objects.active
    add_hand(bpy.context, load_default_hand().for_side("left")).location = (-0.3, 0, 1)
    bpy.context.view_layer.objects.active = first
    assert bpy.ops.livehand.export_splats(filepath=str(tmp_path / "one.glb"), format=".glb", **FEW) == {"FINISHED"}
    path = tmp_path / "all.ply"
    assert bpy.ops.livehand.export_splats(filepath=str(path), format=".ply", hands="ALL", **FEW) == {"FINISHED"}
    assert b"KHR_gaussian_splatting" in (tmp_path / "one.glb").read_bytes()
    x = columns(tmp_path / "all.ply")["x"]
    assert (x > 0).mean() == pytest.approx(0.5, abs=0.1)


def test_a_hidden_hand_is_no_splats(scene, tmp_path):
    for thing in bpy.context.view_layer.objects.active.children_recursive:
        thing.hide_viewport = True
    with pytest.raises(RuntimeError, match="need a visible hand in every frame"):
        bpy.ops.livehand.export_splats(filepath=str(tmp_path / "one.ply"), **FEW)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("has_skin", [pytest.param(True, marks=pytest.mark.nightly), False])
def test_exports_from_the_menu_wear_the_hands_avatar(scene, tmp_path, has_skin):
    path, options = tmp_path / "hand.glb", {"format": "gltf", "has_skin": has_skin, "texture_px": 32}
    assert bpy.ops.livehand.export_take(filepath=str(path), **options) == {"FINISHED"}
    raw = path.read_bytes()
    (length,) = struct.unpack("<I", raw[12:16])
    content = json.loads(raw[20 : 20 + length])
    assert len(content.get("images", [])) == (3 if has_skin else 0)
