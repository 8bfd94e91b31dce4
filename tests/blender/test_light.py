"""Lamps and worlds of a Blender scene as `Light` records: a white patch in their light is as bright as in Cycles."""

import runpy
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.livehand_blender.scene.colour import in_rec709
from mathutils import Matrix

probe = SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "light_probe.py")))
TOLERANCE = 0.02
ABOVE, ASIDE = (0, 0, 1), (0.5, -0.3, 0.8)
LAMPS = {
    "sun": ("SUN", 3, ABOVE, {}),
    "sun aslant": ("SUN", 3, ASIDE, {"angle": 0.0093}),
    "wide sun": ("SUN", 3, ASIDE, {"angle": 0.7}),
    "point": ("POINT", 10, ABOVE, {"shadow_soft_size": 0.0}),
    "sphere": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.25}),
    "scaled sphere": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.1, "scale": (3, 3, 3)}),
    "spot inside": ("SPOT", 10, ABOVE, {"spot_size": 1.0, "spot_blend": 0.0, "shadow_soft_size": 0.0}),
    "spot in its blend": ("SPOT", 10, ABOVE, {"spot_size": 0.28, "spot_blend": 1.0, "shadow_soft_size": 0.02}),
    "spot aslant": ("SPOT", 10, ASIDE, {"spot_size": 0.6, "spot_blend": 0.8, "shadow_soft_size": 0.05}),
    "spot scaled": (
        "SPOT",
        10,
        ABOVE,
        {"spot_size": 0.14, "spot_blend": 1.0, "shadow_soft_size": 0.0, "scale": (2, 2, 1)},
    ),
    "square": ("AREA", 10, ASIDE, {"size": 0.5}),
    "small square": ("AREA", 10, ABOVE, {"size": 0.02}),
    "rectangle": ("AREA", 10, ASIDE, {"shape": "RECTANGLE", "size": 0.9, "size_y": 0.2}),
    "disk": ("AREA", 10, ASIDE, {"shape": "DISK", "size": 0.6}),
    "ellipse": ("AREA", 10, ASIDE, {"shape": "ELLIPSE", "size": 0.2, "size_y": 0.8}),
    "stretched square": ("AREA", 10, ASIDE, {"size": 0.2, "scale": (3, 1, 2)}),
    "mirrored rectangle": ("AREA", 10, ASIDE, {"shape": "RECTANGLE", "size": 0.9, "size_y": 0.2, "scale": (-1, 1, 1)}),
    "spread": ("AREA", 10, ASIDE, {"size": 0.1, "spread": 1.2}),
    "narrow spread": ("AREA", 10, ABOVE, {"size": 0.3, "spread": 0.3}),
    "colour": ("AREA", 10, ASIDE, {"size": 0.3, "color": (1.0, 0.4, 0.05)}),
    "soft falloff off": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.2, "use_soft_falloff": False}),
}
SINCE_4_5 = {
    "exposure": ("AREA", 10, ASIDE, {"size": 0.3, "exposure": -1.5}),
    "temperature": ("POINT", 10, ASIDE, {"use_temperature": True, "temperature": 3200, "color": (0.5, 1, 1)}),
    "sun's radiance": ("SUN", 3, ASIDE, {"angle": 0.3, "normalize": False}),
    "point's radiance": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.1, "normalize": False}),
    "point without radius": ("POINT", 10, ASIDE, {"shadow_soft_size": 0.0, "normalize": False}),
    "rectangle's radiance": ("AREA", 10, ASIDE, {"size": 0.3, "normalize": False, "scale": (2, 1, 1)}),
    "disk's radiance": ("AREA", 10, ASIDE, {"shape": "DISK", "size": 0.3, "normalize": False}),
}
if bpy.app.version >= (4, 5, 0):
    LAMPS |= SINCE_4_5


@pytest.fixture
def patch(registered):
    return probe.white_patch()


def compare(folder, tolerance=TOLERANCE):
    """Cycles' pixels and those by the record: in the mean, and everywhere by the brightest."""
    cycles, ours = probe.cycles_pixels(folder), probe.expected_pixels(probe.light_now())
    assert cycles.max() > 1e-4
    np.testing.assert_allclose(ours.mean((0, 1)), cycles.mean((0, 1)), rtol=tolerance, atol=1e-3 * cycles.max())
    np.testing.assert_allclose(ours, cycles, atol=3 * tolerance * cycles.max())


@pytest.mark.parametrize("name", LAMPS)
def test_each_kind_of_lamp_is_as_bright_as_in_cycles(patch, tmp_path, name):
    kind, energy, location, settings = LAMPS[name]
    probe.add_lamp(kind, energy, location, **settings)
    compare(tmp_path)


def compare_all_round(folder, tolerance=TOLERANCE, samples=1024):
    """Each way that the patch can face; the bound is a share of the brightest one's irradiance."""
    bpy.context.scene.cycles.samples = samples
    cycles, ours = [], []
    for normal in probe.NORMALS:
        probe.face(normal)
        cycles.append(probe.cycles_pixels(folder).mean((0, 1)))
        ours.append(probe.expected_pixels(probe.light_now()).mean((0, 1)))
    cycles, ours = np.array(cycles), np.array(ours)
    assert cycles.max() > 1e-3
    np.testing.assert_allclose(ours, cycles, rtol=tolerance, atol=0.3 * tolerance * cycles.max())
    return cycles


def test_a_plain_world(patch, tmp_path):
    tree = probe.add_world()
    tree.nodes["Background"].inputs["Color"].default_value = (0.2, 0.5, 0.9, 1)
    tree.nodes["Background"].inputs["Strength"].default_value = 1.7
    compare(tmp_path)
    np.testing.assert_allclose(probe.light_now().sky.radiance[3, 5], [0.34, 0.85, 1.53], rtol=1e-6)


def test_an_environment_lights_the_right_side(patch, tmp_path):
    pixels = np.full((64, 128, 3), 0.02)
    pixels[26:34, 28:40] = (6, 1, 1)  # about +Y, a little above the horizon
    pixels[2:6, :] = (0.2, 3, 0.3)  # the zenith
    pixels[50:60, 92:100] = (0.1, 0.2, 8)  # about -Y, below
    probe.environment(probe.add_world(), pixels)
    cycles = compare_all_round(tmp_path)
    assert cycles[2].argmax() == 0
    assert cycles[3].argmax() == 2


def test_a_turned_environment(patch, tmp_path):
    rng = np.random.default_rng(0)
    pixels = np.kron(rng.uniform(0, 3, (8, 16, 3)) ** 3, np.ones((8, 8, 1)))
    probe.environment(probe.add_world(), pixels, (0.4, -0.3, 1.9))
    compare_all_round(tmp_path)


def test_a_small_sun_in_an_environment_is_a_lamp(patch, tmp_path):
    pixels = np.full((512, 1024, 3), 0.3)
    pixels[150:152, 300:303] = (9000, 8000, 6000)
    image = probe.environment(probe.add_world(), pixels)
    assert image.is_dirty
    light = probe.light_now()
    (sun,) = light.lamps
    row, column = 151, 301.5
    elevation, azimuth = np.pi / 2 - row * np.pi / 512, np.pi - column * 2 * np.pi / 1024
    expected = [np.cos(elevation) * np.cos(azimuth), np.cos(elevation) * np.sin(azimuth), np.sin(elevation)]
    assert -sun.direction @ expected > np.cos(np.deg2rad(0.1))
    assert np.deg2rad(0.5) < sun.angle_rad < np.deg2rad(1.5)
    assert light.sky.radiance.max() < 0.5
    bpy.context.scene.world.cycles.sample_map_resolution = 2048
    compare_all_round(tmp_path)


SKIES = ("SINGLE_SCATTERING", "MULTIPLE_SCATTERING") if bpy.app.version >= (5, 0, 0) else ("NISHITA", "HOSEK_WILKIE")


@pytest.mark.parametrize("kind", SKIES)
def test_a_sky_texture(patch, tmp_path, kind):
    tree = probe.add_world()
    sky = tree.nodes.new("ShaderNodeTexSky")
    sky.sky_type = kind
    if kind != "HOSEK_WILKIE":
        sky.sun_elevation, sky.sun_rotation, sky.sun_intensity = 0.6, 2.1, 0.4
    tree.links.new(sky.outputs[0], tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = 0.1
    compare_all_round(tmp_path)
    assert len(probe.light_now().lamps) == (kind != "HOSEK_WILKIE")


def test_what_the_camera_alone_sees_is_not_light(patch, tmp_path):
    tree = probe.add_world()
    path, mix = tree.nodes.new("ShaderNodeLightPath"), tree.nodes.new("ShaderNodeMixShader")
    shown = tree.nodes.new("ShaderNodeBackground")
    shown.inputs["Color"].default_value = (9, 0, 9, 1)
    tree.links.new(path.outputs["Is Camera Ray"], mix.inputs[0])
    tree.links.new(tree.nodes["Background"].outputs[0], mix.inputs[1])
    tree.links.new(shown.outputs[0], mix.inputs[2])
    tree.links.new(mix.outputs[0], tree.nodes["World Output"].inputs["Surface"])
    tree.nodes["Background"].inputs["Color"].default_value = (0.1, 0.4, 0.2, 1)
    compare(tmp_path)


def test_a_world_is_rendered_once(patch, monkeypatch):
    from livehand.livehand_blender.light import world_map

    runs = []
    run = world_map.subprocess.run
    monkeypatch.setattr(world_map.subprocess, "run", lambda *args, **kwargs: runs.append(args) or run(*args, **kwargs))
    tree = probe.add_world()
    gradient = tree.nodes.new("ShaderNodeTexGradient")
    tree.links.new(gradient.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    first = probe.light_now().sky.radiance
    np.testing.assert_array_equal(probe.light_now().sky.radiance, first)
    assert len(runs) == 1
    tree.nodes["Background"].inputs["Strength"].default_value = 3.0
    np.testing.assert_allclose(probe.light_now().sky.radiance, 3 * first, rtol=1e-4)
    assert len(runs) == 2


def test_an_animated_world_is_read_at_its_frame(patch):
    tree = probe.add_world()
    gradient = tree.nodes.new("ShaderNodeTexGradient")
    tree.links.new(gradient.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    strength = tree.nodes["Background"].inputs["Strength"]
    for frame, value in ((1, 1.0), (3, 3.0)):
        strength.default_value = value
        strength.keyframe_insert("default_value", frame=frame)
    radiance = []
    for frame in (1, 3):
        bpy.context.scene.frame_set(frame)
        radiance.append(probe.light_now().sky.radiance)
    np.testing.assert_allclose(radiance[1], 3 * radiance[0], rtol=1e-4)


def test_a_world_that_cannot_be_rendered_is_an_error_that_names_it(patch, monkeypatch):
    from livehand.livehand_blender.light import world_map

    tree = probe.add_world()
    gradient = tree.nodes.new("ShaderNodeTexGradient")
    tree.links.new(gradient.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    tree.nodes["Background"].inputs["Strength"].default_value = 0.123
    monkeypatch.setattr(world_map, "_blender", lambda: ["false"])
    with pytest.raises(LiveHandError, match=r"world 'Sphere of Light' must be rendered .* failed \(exit status 1\)"):
        probe.light_now()


def test_a_world_that_the_layer_does_not_show_is_black(patch):
    probe.add_world()
    assert probe.light_now().sky is not None
    bpy.context.view_layer.use_sky = False
    assert probe.light_now().sky is None
    bpy.context.view_layer.use_sky = True
    bpy.context.scene.world.cycles_visibility.diffuse = False
    bpy.context.scene.world.update_tag()
    assert probe.light_now().sky is None
    bpy.context.scene.world = None
    assert probe.light_now().sky is None


def test_film_exposure_brightens_all(patch, tmp_path):
    probe.add_lamp("POINT", 10, ASIDE)
    probe.add_world()
    bpy.context.scene.cycles.film_exposure = 2.5
    compare(tmp_path)


def test_nodes_of_a_lamp(patch, tmp_path):
    data = probe.add_lamp("POINT", 10, ASIDE).data
    if data.node_tree is None:  # later versions have nodes at once, and warn
        data.use_nodes = True
    data.node_tree.nodes["Emission"].inputs["Color"].default_value = (0.2, 1.0, 0.5, 1)
    data.node_tree.nodes["Emission"].inputs["Strength"].default_value = 2.0
    compare(tmp_path)


def test_a_lamp_that_takes_light_away_is_left_out_with_a_warning(patch, caplog):
    probe.add_lamp("POINT", -10, ASIDE)
    assert probe.light_now().lamps == ()
    assert "Light 'Point' takes light away" in caplog.text


@pytest.mark.parametrize("scale", [(0, 0, 0), (1, 0, 1), (1, 1, 0)])
@pytest.mark.parametrize("kind", ["SUN", "POINT", "SPOT", "AREA"])
def test_a_lamp_that_is_scaled_to_0_gives_no_light_and_is_named(patch, caplog, kind, scale):
    lamp = probe.add_lamp(kind, 10, ABOVE, scale=scale)
    probe.add_lamp("POINT", 5, ABOVE)
    (other,) = probe.light_now().lamps
    assert other.rgb.max() == pytest.approx(5)
    assert f"Light '{lamp.name}' is scaled to 0; it gives none" in caplog.text


@pytest.mark.parametrize("where", ["location", "scale", "energy", "color"])
def test_a_lamp_that_is_not_finite_is_named(patch, where):
    lamp = probe.add_lamp("AREA", 10, ABOVE)
    if where in ("location", "scale"):
        getattr(lamp, where)[1] = float("nan")
    elif where == "color":
        lamp.data.color = (1, float("nan"), 1)
    else:
        lamp.data.energy = float("inf")
    with pytest.raises(LiveHandError, match=rf"light '{lamp.name}': .* must be .*finite.*; look at its transform"):
        probe.light_now()


def test_lamps_of_instances_and_hidden_lamps(patch, tmp_path):
    lamp = probe.add_lamp("SPOT", 10, (0, 0, 1), spot_size=1.0)
    collection = bpy.data.collections.new("Rig")
    collection.objects.link(lamp)
    instancer = bpy.data.objects.new("Instance", None)
    instancer.instance_type, instancer.instance_collection = "COLLECTION", collection
    instancer.matrix_world = Matrix.Rotation(0.6, 4, "X") @ Matrix.Translation((0.1, 0, 0.2))
    bpy.context.scene.collection.objects.link(instancer)
    hidden = probe.add_lamp("SUN", 3, (0, 0, 1))
    hidden.hide_render = hidden.hide_viewport = True
    unlit = probe.add_lamp("SUN", 3, (0, 0, 1))
    unlit.visible_diffuse = False
    bpy.context.view_layer.update()
    assert [one.kind for one in probe.light_now().lamps] == ["spot", "spot"]
    compare(tmp_path)


def test_light_groups_are_those_of_the_view_layer(patch):
    lamp = probe.add_lamp("SUN", 3, (0, 0, 1))
    probe.add_world()
    lamp.lightgroup, bpy.context.scene.world.lightgroup = "Key", "Sky"
    assert probe.light_now().groups == ("",)
    for name in ("Key", "Sky"):
        bpy.context.view_layer.lightgroups.add(name=name)
    assert probe.light_now().groups == ("Key", "Sky")


def test_a_lamp_without_shadow(patch):
    probe.add_lamp("SUN", 3, (0, 0, 1)).data.use_shadow = False
    assert not probe.light_now().lamps[0].casts_shadow


def link_to(collection, thing, state):
    collection.objects.link(thing)
    collection.collection_objects[-1].light_linking.link_state = state


def nested(collection, thing, state):
    inner = bpy.data.collections.new("Inner")
    inner.objects.link(thing)
    collection.children.link(inner)
    collection.collection_children[-1].light_linking.link_state = state


LINKS = {
    "empty": [],
    "included": [(link_to, "Patch", "INCLUDE")],
    "excluded": [(link_to, "Patch", "EXCLUDE")],
    "other included": [(link_to, "Other", "INCLUDE")],
    "other excluded": [(link_to, "Other", "EXCLUDE")],
    "both": [(link_to, "Other", "EXCLUDE"), (link_to, "Patch", "INCLUDE")],
    "nested included": [(nested, "Patch", "INCLUDE")],
    "nested excluded": [(nested, "Patch", "EXCLUDE")],
    "included, nested excluded": [(link_to, "Patch", "INCLUDE"), (nested, "Patch", "EXCLUDE")],
    "excluded, nested included": [(nested, "Patch", "INCLUDE"), (link_to, "Patch", "EXCLUDE")],
}


@pytest.mark.parametrize("name", LINKS)
def test_light_linking_is_that_of_cycles(patch, tmp_path, name):
    probe.square("Other", 0.1, (5, 0, 0))
    lamp = probe.add_lamp("SUN", 3, (0, 0, 1))
    lamp.light_linking.receiver_collection = collection = bpy.data.collections.new("Receivers")
    for link, thing, state in LINKS[name]:
        link(collection, bpy.data.objects[thing], state)
    is_lit = probe.cycles_pixels(tmp_path).max() > 0.1
    assert bool(probe.light_now().lamps) == is_lit


def test_a_mesh_that_does_not_block_a_lamp_is_lit_without_shadows(patch):
    lamp = probe.add_lamp("SUN", 3, (0, 0, 1))
    lamp.light_linking.blocker_collection = collection = bpy.data.collections.new("Blockers")
    link_to(collection, bpy.data.objects["Patch"], "EXCLUDE")
    assert not probe.light_now().lamps[0].casts_shadow


if bpy.app.version >= (5, 0, 0):

    def test_another_working_space(patch, tmp_path):
        bpy.ops.wm.set_working_color_space(working_space="ACEScg", convert_colors=True)
        data = probe.add_lamp("POINT", 10, ASIDE).data
        data.color = (0.5, 0.45, 0.4)
        tree = probe.add_world()
        gradient, mix = tree.nodes.new("ShaderNodeTexGradient"), tree.nodes.new("ShaderNodeMix")
        mix.data_type = "RGBA"
        mix.inputs[0].default_value, mix.inputs[6].default_value = 0.0, (0.5, 0.45, 0.4, 1)
        tree.links.new(gradient.outputs[0], mix.inputs[7])
        tree.links.new(mix.outputs[2], tree.nodes["Background"].inputs["Color"])
        cycles = in_rec709(probe.cycles_pixels(tmp_path).mean((0, 1)))
        np.testing.assert_allclose(probe.expected_pixels(probe.light_now()).mean((0, 1)), cycles, rtol=TOLERANCE)
