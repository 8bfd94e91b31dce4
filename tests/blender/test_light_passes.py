"""Cycles' light passes of the bare hand, measured in the middle of a frame's render; how the hand lights the scene."""

import bpy
import numpy as np
import pytest
import torch
from livehand.backend.geometry.mesh import vertex_normals
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.shot import SurfaceMesh
from livehand.livehand_blender.hands.proxy import use_albedo
from livehand.livehand_blender.render.light_passes import binning, measured_light, samples_of
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import find_hands, mesh_of
from livehand.livehand_blender.scene.camera import Region
from mathutils import Vector

SUN = Vector((0.3, -0.2, 1.0)).normalized()

# Cycles' passes in the version that runs.
DIRECT, INDIRECT = ("Diffuse Direct", "Diffuse Indirect") if bpy.app.version >= (5, 0, 0) else ("DiffDir", "DiffInd")


@pytest.fixture
def lit_scene(hand_scene, fake_session, fake_renderer, monkeypatch):
    """The hand in its scene under a sun of 3 W/m^2."""
    monkeypatch.setattr(fake_renderer, "is_relightable", True)
    monkeypatch.setattr(fake_renderer, "mean_albedo", np.array([0.5, 0.32, 0.25]))
    scene = hand_scene
    scene.livehand.mode = "SCENE"
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.resolution_x, scene.render.resolution_y = 96, 128
    scene.camera.location = (0.06, 0, 0.6)
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.data.angle = 3.0, 0.0
    sun.rotation_euler = SUN.to_track_quat("Z", "Y").to_euler()
    scene.collection.objects.link(sun)
    return scene


@pytest.fixture
def shots(fake_session, tmp_path):
    """A function: scene -> what was rendered of each hand."""

    def of(scene):
        scene.render.filepath = str(tmp_path / "still.png")
        bpy.ops.render.render(write_still=True)
        return fake_session.made[-1].shots

    return of


def depth_and_normal(scene, tmp_path, read_exr, use_multilayer_exr):
    """[H, W, 3] normals of the hand's mesh at the middle of pixels, and where there is any, by Cycles alone."""
    scene.render.engine = "CYCLES"
    scene.render.film_transparent = True
    layer = scene.view_layers[0]
    layer.use_pass_normal = True
    scene.cycles.samples = 16
    use_multilayer_exr(scene)
    scene.render.filepath = str(tmp_path / "normal.exr")
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "normal.exr")
    normal = np.stack([channels[f"{layer.name}.Normal.{c}"] for c in "XYZ"], -1)
    return normal, channels[f"{layer.name}.Combined.A"]


def test_a_sun_is_measured(lit_scene, shots, tmp_path, read_exr, use_multilayer_exr):
    (shot,) = shots(lit_scene)
    measured = shot.light.measured
    assert measured.alpha.shape == (64, 48)
    normal, alpha = depth_and_normal(lit_scene, tmp_path, read_exr, use_multilayer_exr)
    halves = alpha.reshape(64, 2, 48, 2).mean((1, 3))
    np.testing.assert_allclose(measured.alpha, halves, atol=0.25)
    assert np.abs(measured.alpha - halves).mean() < 0.02
    facing = np.clip(normal @ np.array(SUN), 0, None) * 3 / np.pi
    expected = facing.reshape(64, 2, 48, 2).mean((1, 3))
    is_inside = (halves > 0.99) & (expected > 0.3)
    ratio = measured.direct[is_inside] / expected[is_inside][:, None]
    assert is_inside.sum() > 60
    assert np.median(ratio) == pytest.approx(1, abs=0.03)  # of the palm, little lies in the fingers' shade
    assert measured.direct[measured.alpha == 0].max() == 0


def base_colour(material):
    return np.array(material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value)


def test_the_hand_reflects_as_its_skin_does_and_its_own_material_does_not_change(hand_scene):
    mesh, updates = mesh_of(find_hands(hand_scene)[0]), []
    before = base_colour(mesh.active_material)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    bpy.app.handlers.depsgraph_update_post.append(lambda *_: updates.append(True))
    try:
        use_albedo(depsgraph, {mesh.name: [0.1, 0.2, 0.3]})
        bpy.context.view_layer.update()
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()
    material = mesh.evaluated_get(depsgraph).active_material
    np.testing.assert_allclose(base_colour(material), [0.1, 0.2, 0.3, 1], atol=1e-6)
    np.testing.assert_array_equal(base_colour(mesh.active_material), before)
    assert not updates


def test_the_users_own_material_stays(hand_scene):
    mesh = mesh_of(find_hands(hand_scene)[0])
    mesh.active_material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0, 1, 0, 1)
    depsgraph = bpy.context.evaluated_depsgraph_get()
    use_albedo(depsgraph, {mesh.name: [0.1, 0.2, 0.3]})
    np.testing.assert_array_equal(base_colour(mesh.evaluated_get(depsgraph).active_material), [0, 1, 0, 1])


def add_floor(scene, z):
    mesh = bpy.data.meshes.new("Floor")
    mesh.from_pydata([(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)], [], [(0, 1, 2, 3)])
    floor = bpy.data.objects.new("Floor", mesh)
    floor.location.z = z
    scene.collection.objects.link(floor)
    return floor


def light_on_floor(scene, tmp_path, read_exr, use_multilayer_exr):
    """[H, W, 3] indirect light of Cycles' floor in the frame."""
    layer = scene.view_layers[0]
    layer.use_pass_diffuse_indirect = True
    use_multilayer_exr(scene)
    scene.render.filepath = str(tmp_path / "floor.exr")
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "floor.exr")
    return np.stack([channels[f"{layer.name}.{INDIRECT}.{c}"] for c in "RGB"], -1)


@pytest.mark.parametrize(("of_scene", "measured"), [(1, 4), (16, 4), (64, 16), (4096, 32)])
def test_light_is_measured_in_a_quarter_of_the_scenes_samples(of_scene, measured):
    assert samples_of(of_scene) == measured


def test_skin_bleeds_on_the_scene(
    lit_scene, fake_session, fake_renderer, tmp_path, read_exr, use_multilayer_exr, monkeypatch
):
    add_floor(lit_scene, -0.05)
    lit_scene.cycles.samples = 8
    lit_scene.render.film_transparent = False
    for rgb in ([0.8, 0.0, 0.0], [0.0, 0.8, 0.0]):
        monkeypatch.setattr(fake_renderer, "mean_albedo", np.array(rgb))
        bled = light_on_floor(lit_scene, tmp_path, read_exr, use_multilayer_exr).mean((0, 1))
        strong, weak = (bled[0], bled[1]) if rgb[0] else (bled[1], bled[0])
        assert strong > 3 * weak  # the rest is the gloss of the skin


def test_the_scene_shades_the_hand_where_the_sun_comes_from(lit_scene, shots):
    """A ball on the line from the hand's middle to the sun."""
    (lit,) = shots(lit_scene)
    before = lit.light.measured
    bpy.ops.mesh.primitive_uv_sphere_add(radius=0.03, location=Vector(lit.vertices.mean(0).tolist()) + 0.15 * SUN)
    after = shots(lit_scene)[-1].light.measured
    pixel, _ = lit.camera.project(lit.vertices.mean(0))
    x, y = (pixel // 2).astype(int)
    near = np.s_[y - 1 : y + 2, x - 1 : x + 2]
    assert after.alpha[near].min() > 0.5
    assert before.direct[near].mean() > 0.3
    assert after.direct[near].mean() < 0.05


@pytest.mark.parametrize("offset_m", [None, 0.08])
def test_the_hand_shades_the_scene_away_from_the_sun(
    lit_scene, fake_session, fake_renderer, monkeypatch, tmp_path, read_exr, use_multilayer_exr, offset_m
):
    """On the floor the direct light is gone where the line to the sun meets the hand's surface, and only there."""
    offset = np.array([offset_m or 0, 0, 0])
    if offset_m:
        moved = {"posed_surface": lambda self, shot: SurfaceMesh(shot.vertices + offset, load_default_hand().f)}
        monkeypatch.setattr(fake_renderer, *moved.popitem())
    z = -0.3
    add_floor(lit_scene, z)
    lit_scene.cycles.samples, lit_scene.render.film_transparent = 4, False
    lit_scene.camera.location.z = 1.5
    layer = lit_scene.view_layers[0]
    layer.use_pass_diffuse_direct = True
    use_multilayer_exr(lit_scene)
    lit_scene.render.filepath = str(tmp_path / "floor.exr")
    bpy.ops.render.render(write_still=True)
    light = read_exr(tmp_path / "floor.exr")[f"{layer.name}.{DIRECT}.R"]
    shot = fake_session.made[-1].shots[-1]
    vertices = shot.vertices + offset
    away = np.array(SUN) * ((vertices[:, 2:] - z) / SUN.z)
    columns, rows = shot.camera.project(vertices - away)[0].astype(int).T
    is_inside = (columns >= 0) & (columns < 96) & (rows >= 0) & (rows < 128)
    shadow = np.zeros((128, 96), bool)
    shadow[rows[is_inside], columns[is_inside]] = True
    assert light[shadow].mean() < 0.35 * np.median(light)
    grown = shadow.copy()
    for _ in range(3):
        grown[1:] |= grown[:-1]
        grown[:-1] |= grown[1:]
        grown[:, 1:] |= grown[:, :-1]
        grown[:, :-1] |= grown[:, 1:]
    np.testing.assert_allclose(light[~grown], np.median(light), rtol=0.02)


def test_every_hand_is_measured_alone(lit_scene, shots):
    """The other hand, nearer to the camera, does not hide it, nor is it in its maps."""
    (one,) = shots(lit_scene)
    other = add_hand(bpy.context, load_default_hand(), name="Other")
    other.location = (0, 0, 0.05)
    first, second = sorted(shots(lit_scene)[-2:], key=lambda shot: shot.vertices[:, 2].mean())
    np.testing.assert_allclose(first.light.measured.alpha, one.light.measured.alpha, atol=0.02)
    assert second.light.measured.alpha.sum() > 1.05 * first.light.measured.alpha.sum()


def test_a_border_and_odd_sides(lit_scene, shots):
    """A crop is measured on its own grid; sides that have no half keep their pixels."""
    (whole,) = shots(lit_scene)
    render = lit_scene.render
    render.use_border, render.use_crop_to_border = True, True
    render.border_min_x, render.border_max_x, render.border_min_y, render.border_max_y = 0.25, 0.76, 0.25, 0.75
    part = shots(lit_scene)[-1].light.measured
    assert part.alpha.shape == (32, 24)
    expected = whole.light.measured.alpha[16:48, 12:36]
    assert np.abs(part.alpha - expected).mean() < 0.02
    render.border_min_x = 0.2605
    odd = shots(lit_scene)[-1].light.measured
    assert odd.alpha.shape == (32, 47)
    assert np.abs(odd.alpha[:, 1::2] - part.alpha[:, 1:]).mean() < 0.1


def test_the_file_does_not_change(lit_scene, shots):
    names = ("scenes", "objects", "cameras", "materials", "worlds", "meshes")
    before = {name: [one.name for one in getattr(bpy.data, name)] for name in names}
    called = []
    bpy.app.handlers.render_pre.append(lambda *_: called.append(True))
    try:
        shots(lit_scene)
    finally:
        bpy.app.handlers.render_pre.pop()
    assert {name: [one.name for one in getattr(bpy.data, name)] for name in names} == before
    assert len(called) == 1  # of the user's render


def inner_surface(shot):
    """Inside the hand's mesh, which would shade it all."""
    vertices = torch.as_tensor(shot.vertices, dtype=torch.float32)
    inwards = 0.002 * vertex_normals(vertices, torch.as_tensor(load_default_hand().f)).numpy()
    return SurfaceMesh(shot.vertices - inwards, load_default_hand().f)


def test_light_is_measured_on_the_skins_own_surface(lit_scene, shots, fake_renderer, monkeypatch):
    (of_mesh,) = (shot.light.measured for shot in shots(lit_scene))
    monkeypatch.setattr(fake_renderer, "posed_surface", lambda self, shot: inner_surface(shot))
    before = {name: len(getattr(bpy.data, name)) for name in ("objects", "meshes", "scenes")}
    measured = shots(lit_scene)[-1].light.measured
    assert (of_mesh.on_surface, measured.on_surface) == (False, True)
    assert 0.7 < measured.alpha.sum() / of_mesh.alpha.sum() < 0.97
    inside = measured.alpha > 0.99
    assert np.median(measured.direct[inside] / of_mesh.direct[inside].clip(1e-3)) == pytest.approx(1, abs=0.05)
    assert {name: len(getattr(bpy.data, name)) for name in before} == before


@pytest.mark.parametrize("is_persistent", [False, True])
def test_a_hand_that_rests_stays_where_it_is(
    lit_scene, fake_session, fake_renderer, monkeypatch, tmp_path, is_persistent
):
    """Vertices that one frame moves in Cycles' scene are not those that the next one reads."""
    monkeypatch.setattr(fake_renderer, "posed_surface", lambda self, shot: inner_surface(shot))
    mesh = mesh_of(find_hands(lit_scene)[0]).data
    before = [tuple(vertex.co) for vertex in mesh.vertices]
    lit_scene.render.use_persistent_data = is_persistent
    lit_scene.frame_start, lit_scene.frame_end = 1, 3
    lit_scene.render.filepath = str(tmp_path / "rest_")
    bpy.ops.render.render(animation=True)
    first, *others = (shot.vertices for made in fake_session.made for shot in made.shots)
    assert len(others) == 2
    assert all(np.array_equal(first, other) for other in others)
    assert [tuple(vertex.co) for vertex in mesh.vertices] == before


def test_light_that_is_linked_to_the_mesh_is_measured_on_the_mesh(lit_scene, shots, fake_renderer, monkeypatch):
    monkeypatch.setattr(fake_renderer, "posed_surface", lambda self, shot: inner_surface(shot))
    linked = bpy.data.collections.new("Linked")
    bpy.data.objects["Sun"].light_linking.receiver_collection = linked
    assert shots(lit_scene)[-1].light.measured.on_surface
    linked.objects.link(mesh_of(find_hands(lit_scene)[0]))
    assert not shots(lit_scene)[-1].light.measured.on_surface


def test_nothing_is_measured_without_a_scene_or_in_the_captures_light(lit_scene, shots):
    lit_scene.livehand.mode = "HAND"
    assert shots(lit_scene)[-1].light.measured is None
    lit_scene.livehand.mode, lit_scene.livehand.light = "SCENE", "CAPTURE"
    assert shots(lit_scene)[-1].light is None


def test_a_hand_in_the_dark_is_told_of(lit_scene, shots, caplog):
    lit_scene.livehand.mode, lit_scene.world = "HAND", None
    shots(lit_scene)
    assert "lights" not in caplog.text
    bpy.data.objects.remove(bpy.data.objects["Sun"])
    shots(lit_scene)
    assert f"No light and no world lights '{find_hands(lit_scene)[0].name}'" in caplog.text


def test_maps_are_straight_means_of_the_hands_pixels():
    """Two pixels of a 2 x 2 block show the hand, one of them by half; the box lies at the image's right."""
    alpha = np.array([[1.0, 0.5], [0, 0]], np.float32)
    light = np.array([[3.0, 9.0], [7, 7]], np.float32)[..., None] * np.ones(3, np.float32)
    combined = np.concatenate([light, alpha[..., None]], -1)
    maps = {"Combined": combined, "DiffDir": light, "DiffInd": 0 * light, "DiffCol": light}
    measured = measured_light(maps, Region(2, 0, (2, 2)), (4, 2))
    np.testing.assert_allclose(measured.direct, [[[0] * 3, [(3 + 4.5) / 1.5] * 3]])
    np.testing.assert_allclose(measured.alpha, [[0, 0.375]])


def test_a_hand_without_diffuse_light_is_not_measured():
    zero = np.zeros((2, 2, 3), np.float32)
    maps = {"Combined": np.ones((2, 2, 4), np.float32), "DiffDir": zero, "DiffInd": zero, "DiffCol": zero}
    assert measured_light(maps, Region(0, 0, (2, 2)), (2, 2)) is None


def test_odd_sides_keep_their_pixels():
    assert binning((96, 127)) == (2, 1)


def test_a_blurred_frame_is_measured_once(lit_scene, shots):
    lit_scene.render.use_motion_blur, lit_scene.livehand.blur_samples = True, 3
    found = {id(shot.light.measured) for shot in shots(lit_scene)}
    assert len(found) == 1


def test_both_eyes_are_measured(lit_scene, shots):
    lit_scene.render.use_multiview = True
    lit_scene.camera.data.stereo.interocular_distance = 0.06
    lit_scene.camera.location.z = 0.9  # from where each eye sees hand and arm whole
    lit_scene.render.image_settings.views_format = "INDIVIDUAL"
    left, right = (shot.light.measured.alpha for shot in shots(lit_scene))
    assert left.sum() == pytest.approx(right.sum(), rel=0.02)
    middles = [np.average(np.arange(alpha.shape[1]), weights=alpha.sum(0)) for alpha in (left, right)]
    assert 2 < middles[0] - middles[1] < 4  # 60 mm of 0.49 m in 48 pixels, halved as the eyes converge 1.95 m away


def test_avatars_without_an_albedo_are_not_measured(lit_scene, shots, fake_renderer, monkeypatch):
    monkeypatch.setattr(fake_renderer, "mean_albedo", None)
    assert shots(lit_scene)[-1].light.measured is None
