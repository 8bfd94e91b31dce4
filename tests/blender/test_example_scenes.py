"""The example scenes: their scripts make the same files, and the hands are visible and occluded as intended."""

import runpy
import tomllib
from pathlib import Path

import bpy
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.rig.hand import find_hands, mesh_of
from livehand.tools.assets_lock import LIMIT_BYTES

TIPS = {3: "Index", 6: "Middle", 9: "Pinky", 12: "Ring", 15: "Thumb"}
EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(autouse=True)
def _scripts_find_each_other(monkeypatch):
    monkeypatch.syspath_prepend(EXAMPLES)


def open_example(name):
    bpy.ops.wm.open_mainfile(filepath=str(EXAMPLES / f"{name}.blend"))
    return bpy.context.scene


def world_vertices(thing):
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    mesh = evaluated.to_mesh()
    return np.array([evaluated.matrix_world @ vertex.co for vertex in mesh.vertices])


@pytest.mark.parametrize("name", ["grasp", "clasp", "edited", "follow", "egg"])
def test_the_file_is_what_its_script_makes(name):
    def contents(scene):
        return {
            **{thing.name: world_vertices(thing) for thing in scene.objects if thing.type == "MESH"},
            "camera": np.array(scene.camera.matrix_world),
        }

    saved = contents(open_example(name))
    assert not bpy.data.texts
    assert not bpy.data.libraries
    bpy.ops.wm.read_homefile(use_empty=True)
    made = contents(runpy.run_path(str(EXAMPLES / f"make_{name}.py"))[f"build_{name}"]())
    assert saved.keys() == made.keys()
    for key, values in saved.items():
        np.testing.assert_allclose(made[key], values, atol=1e-6, err_msg=key)


@pytest.mark.parametrize("name", ["grasp", "clasp", "edited", "follow", "egg", "wave"])
def test_it_opens_as_a_finished_shot_and_is_not_newer_than_any_blender_that_runs_livehand(name):
    scene = open_example(name)
    oldest = tomllib.loads((EXAMPLES.parent / "blender_manifest.toml").read_text())["blender_version_min"]
    assert ".".join(map(str, bpy.data.version[:2])) == oldest.rpartition(".")[0]
    assert (EXAMPLES / f"{name}.blend").stat().st_size <= LIMIT_BYTES
    assert scene.camera is not None
    areas = [area for screen in bpy.data.screens for area in screen.areas if area.type == "VIEW_3D"]
    assert areas
    for space in (area.spaces.active for area in areas):
        assert space.region_3d.view_perspective == "CAMERA"  # Blender opens every file in solid shading


def test_the_pads_of_the_digits_hold_the_egg():
    """Its shell is a surface of revolution; a digit touches it, and goes no deeper than flesh yields."""
    scene = open_example("egg")
    skin = world_vertices(mesh_of(find_hands(scene)[0]))
    inverse = np.array(scene.objects["Egg"].matrix_world.inverted())
    x, y, z = (skin @ inverse[:3, :3].T + inverse[:3, 3]).T
    height = np.clip(z / 0.0275, -1, 1)
    radius_m = 0.0215 * (1 - 0.14 * height) / (1 + 0.14**2 / 2) * np.sqrt(1 - height**2)
    depth_m = radius_m - np.hypot(x, y)
    depth_m[np.abs(z) > 0.0275] = -1
    joint = load_default_hand().lbs_weights.argmax(1)
    deepest_m = {finger: depth_m[joint == tip].max() for tip, finger in TIPS.items()}
    assert sum(depth > -0.0015 for depth in deepest_m.values()) >= 4, deepest_m
    assert depth_m.max() < 0.0025


@pytest.mark.parametrize("frame", [1, 12, 24])
def test_the_hand_holds_the_tumbler(frame):
    """The skin touches the tumbler's side, and goes no deeper than flesh yields, also when both are moved."""
    scene = open_example("grasp")
    scene.frame_set(frame)
    tumbler = scene.objects["Tumbler"]
    skin = world_vertices(mesh_of(find_hands(scene)[0]))
    inverse = np.array(tumbler.matrix_world.inverted())
    local = skin @ inverse[:3, :3].T + inverse[:3, 3]
    beside = (local[:, 2] > 0.002) & (local[:, 2] < 0.123)
    depth_m = 0.031 - np.linalg.norm(local[beside, :2], axis=1)
    assert 0 < depth_m.max() < 0.002
    assert (depth_m > -0.001).sum() > 20


@pytest.fixture
def rendered(read_exr, use_multilayer_exr, tmp_path):
    """A function that renders the scene with its Hand passes and returns channels of some passes."""

    def of(scene, passes=("HandAlpha.A",)):
        use_multilayer_exr(scene)
        scene.view_layers[0].livehand.use_pass_hand = True
        scene.render.filepath = str(tmp_path / "scene.exr")
        bpy.ops.render.render(write_still=True)
        channels = read_exr(tmp_path / "scene.exr")
        return [channels[f"{scene.view_layers[0].name}.{name}"] for name in passes]

    return of


def test_the_tumbler_hides_the_palm_and_not_the_fingertips(rendered):
    scene = open_example("grasp")
    scene.frame_set(12)
    scene.render.resolution_percentage, scene.cycles.samples, scene.cycles.use_denoising = 25, 1, False
    visible, hand = rendered(scene, ("HandAlpha.A", "Hand.A"))
    # Pixels in the full image: the palm behind the tumbler, the middle fingertip in front of it, thumb, wrist.
    for (x, y), is_seen in {(240, 200): False, (176, 278): True, (325, 190): True, (400, 180): True}.items():
        assert hand[y // 4, x // 4] > 0.95
        assert visible[y // 4, x // 4] == pytest.approx(float(is_seen), abs=0.05)
    assert (visible <= hand + 1e-3).all()


def test_each_of_a_clasped_pair_hides_part_of_the_other(rendered):
    scene = open_example("clasp")
    scene.render.resolution_percentage = 25
    scene.view_layers[0].use_pass_cryptomatte_object = True
    (both,) = rendered(scene)
    one, other = find_hands(scene)
    alone = []
    for hand in (one, other):
        mesh_of(hand).hide_render = True
        alone += rendered(scene)
        mesh_of(hand).hide_render = False
    difference = np.abs(both - np.maximum(*alone))  # where two soft edges meet, they cover more than either
    assert difference.max() < 0.4
    assert (difference > 0.26).mean() < 2e-3
    overlap = np.minimum(*alone) > 0.95
    assert overlap.sum() > 300
    np.testing.assert_allclose(both[overlap], 1, atol=0.05)


def test_the_hand_follows_the_sticks():
    """The sticks' ends are close to our skin; bones of other lengths cannot be matched exactly."""
    scene = open_example("follow")
    (hand,) = find_hands(scene)
    rig = scene.objects["Stick Figure"]
    tips = {joint: f"mixamorig:RightHand{finger}4" for joint, finger in TIPS.items()}
    model = load_default_hand()
    errors_mm = []
    for frame in range(1, 38, 4):
        scene.frame_set(frame)
        skin = world_vertices(mesh_of(hand))
        for joint, bone in tips.items():
            end = np.array(rig.matrix_world @ rig.pose.bones[bone].head)
            own = skin[np.argmax(model.lbs_weights, 1) == joint]
            errors_mm.append(1e3 * np.linalg.norm(own - end, axis=1).min())
    assert np.mean(errors_mm) < 3
    assert np.max(errors_mm) < 5.5
