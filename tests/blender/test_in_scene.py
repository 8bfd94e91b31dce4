"""Hands in their scene: one render gives Cycles' picture with the hands in it, occluded by nearer objects."""

import bpy
import numpy as np
import pytest
from livehand.backend.hand.arm_end import distance_from_end_m
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.render.cryptomatte import crypto_id
from livehand.livehand_blender.hands import visible_hands
from livehand.livehand_blender.render.cycles import is_in_scene
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import find_hands, mesh_of
from mathutils import Matrix
from PIL import Image

LAYER = "ViewLayer"


@pytest.fixture
def shot(hand_scene, fake_session):
    """A grey wall 0.2 m behind the hand (which the fake renderer draws as a disc at its depth), lit from the side."""
    scene = hand_scene
    scene.livehand.mode = "SCENE"
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.cycles.use_adaptive_sampling = False
    scene.render.film_transparent = False
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.rotation_euler = (0.5, 0.3, 0)
    scene.collection.objects.link(sun)
    add_wall(scene, "Wall", -0.2, 3.0)
    return scene


def add_wall(scene, name, z, size, x=0.0):
    """A square wall across the camera's view, whose edge towards -x is at `x` - size / 2."""
    mesh = bpy.data.meshes.new(name)
    half = size / 2
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    wall = bpy.data.objects.new(name, mesh)
    wall.location = (x, 0, z)
    scene.collection.objects.link(wall)
    return wall


@pytest.fixture
def render(tmp_path, read_exr, use_multilayer_exr):
    """A function: scene -> {pass.channel: [H, W]} of its first layer."""

    def of(scene, name="shot.exr", layer=LAYER):
        path = tmp_path / name
        scene.render.filepath = str(path)
        use_multilayer_exr(scene)
        bpy.ops.render.render(write_still=True)
        channels = read_exr(path)
        return {k.removeprefix(f"{layer}."): v for k, v in channels.items() if k.startswith(layer)}

    return of


def rgb(channels, name="Combined"):
    return np.stack([channels[f"{name}.{c}"] for c in "RGB"], -1)


@pytest.mark.parametrize("lens", ["PERSP", "ORTHO"])
def test_the_hand_covers_the_wall_behind_it(shot, fake_session, fake_renderer, render, lens):
    shot.camera.data.type, shot.camera.data.ortho_scale = lens, 0.6
    channels = render(shot)
    assert fake_session.made[-1].shots[-1].camera.is_orthographic == (lens == "ORTHO")
    frame = fake_renderer().render(fake_session.made[-1].shots[-1])
    for hand in find_hands(shot):
        mesh_of(hand).visible_camera = False
    shot.render.engine = "CYCLES"
    wall = render(shot, "wall.exr")
    expected = frame.rgb + (1 - frame.alpha)[..., None] * rgb(wall)
    np.testing.assert_allclose(rgb(channels), expected, atol=1e-5)
    assert np.ptp(rgb(wall)) > 0.1  # the hand's shadow lies on the wall
    assert (frame.alpha > 0.9).any()
    np.testing.assert_allclose(channels["Combined.A"], 1, atol=1e-6)
    np.testing.assert_allclose(channels["Depth.Z"], np.where(frame.alpha >= 0.5, frame.depth, 0.7), atol=1e-4)


def test_objects_before_the_hand_hide_it(shot, fake_session, fake_renderer, render):
    shot.view_layers[0].livehand.use_pass_hand = True
    add_wall(shot, "Screen", 0.3, 2.0, x=-0.08 + 1.0)  # its edge crosses the middle of the picture
    channels = render(shot)
    frame = fake_renderer().render(fake_session.made[-1].shots[-1])
    middle = frame.alpha.shape[1] // 2
    np.testing.assert_allclose(channels["HandAlpha.A"][:, : middle - 1], frame.alpha[:, : middle - 1], atol=1e-5)
    assert channels["HandAlpha.A"][:, middle + 1 :].max() == 0
    np.testing.assert_allclose(channels["Hand.A"], frame.alpha, atol=1e-5)
    np.testing.assert_allclose(rgb(channels, "Hand"), frame.rgb, atol=1e-5)
    np.testing.assert_allclose(channels["Depth.Z"][:, middle + 1 :], 0.2, atol=1e-4)


def test_the_hands_of_a_frame_are_read_once(shot, render, monkeypatch):
    layer, readings, read = shot.view_layers[0], [], visible_hands._hand_instances
    layer.use_pass_cryptomatte_object = layer.use_pass_vector = True
    monkeypatch.setattr(visible_hands, "_hand_instances", lambda depsgraph: readings.append(1) or read(depsgraph))
    channels = render(shot)
    assert {"CryptoObject00.R", "Vector.X"} <= {name.replace(".r", ".R") for name in channels}
    assert len(readings) == 1


def test_what_the_wrists_fade_leaves_has_a_pass(shot, render):
    model = load_default_hand()
    for hand in find_hands(shot):
        hand.livehand.wrist_fade = 1000 * distance_from_end_m(model).max()  # from the elbow to the fingertips
    shot.view_layers[0].livehand.use_pass_fade = True
    fade = render(shot)["HandFade.A"]
    assert fade.max() == pytest.approx(1, abs=0.01)
    assert fade.min() == 0
    assert np.ptp(fade[fade > 0]) > 0.2


def test_the_hands_mesh_and_the_layer_do_not_change(shot, render):
    render(shot)
    assert all(mesh_of(hand).visible_camera for hand in find_hands(shot))
    assert shot.view_layers[0].use_pass_z


def test_cycles_renders_depth_even_if_the_layer_has_it_off(shot, render):
    add_wall(shot, "Screen", 0.3, 3.0)
    shot.view_layers[0].use_pass_z = False
    shot.view_layers[0].livehand.use_pass_hand = True
    assert render(shot)["HandAlpha.A"].max() == 0


def test_a_layer_without_the_hand_is_cycles_alone(shot, fake_session, render):
    mesh_of(find_hands(shot)[0]).hide_render = True
    channels = render(shot)
    assert fake_session.made == []
    shot.render.engine = "CYCLES"
    np.testing.assert_array_equal(rgb(channels), rgb(render(shot, "cycles.exr")))


def test_border_and_percentage(shot, render):
    whole = rgb(render(shot))
    settings = shot.render
    settings.use_border, settings.use_crop_to_border = True, True
    settings.border_min_x, settings.border_max_x, settings.border_min_y, settings.border_max_y = 0.25, 0.75, 0.25, 0.75
    part = rgb(render(shot, "part.exr"))
    assert part.shape == (32, 24, 3)
    # Cycles' noise has another seed at other pixels; the hand, half of the picture, has none.
    assert np.median(np.abs(part - whole[16:48, 12:36])) < 0.02


def test_other_passes_of_cycles_are_kept(shot, render):
    shot.view_layers[0].use_pass_normal = shot.view_layers[0].use_pass_mist = True
    channels = render(shot)
    normal = np.stack([channels[f"Normal.{c}"] for c in "XYZ"], -1)
    np.testing.assert_allclose(normal[0, 0], [0, 0, 1], atol=1e-3)  # of the wall
    is_hand = channels["Depth.Z"] < 0.6
    np.testing.assert_allclose(np.linalg.norm(normal, axis=-1), 1, atol=1e-3)
    assert (normal[is_hand][:, 2] < 0.9).any()
    assert channels["Mist.Z"].shape == is_hand.shape


def test_two_hands_in_either_order(shot, fake_session, render):
    right = find_hands(shot)[0]
    left = add_hand(bpy.context, load_default_hand().for_side("left"), name="Another")
    left.matrix_world = Matrix.Translation((-0.16, 0, 0.05))
    first = render(shot)
    assert len(fake_session.made[-1].shots) == 2
    right.name, left.name = "ZZ", "AA"
    second = render(shot, "renamed.exr")
    for name, values in first.items():
        np.testing.assert_array_equal(values, second[name], err_msg=name)


def test_stereo(shot, render, tmp_path):
    shot.render.use_multiview = True
    shot.camera.data.stereo.interocular_distance = 0.06
    shot.render.image_settings.views_format = "INDIVIDUAL"
    shot.render.filepath = str(tmp_path / "eyes.png")
    shot.render.image_settings.file_format = "PNG"
    bpy.ops.render.render(write_still=True)

    left, right = (np.array(Image.open(tmp_path / f"eyes_{eye}.png")).astype(int) for eye in "LR")
    assert left.shape == right.shape == (64, 48, 4)
    assert np.abs(left - right).mean() > 1
    assert (left[..., 3] == 255).all()


def test_without_cycles_the_error_has_a_remedy(shot):
    class NoCycles:
        livehand = shot.livehand

    with pytest.raises(Exception, match="Cycles add-on, which is switched off"):
        is_in_scene(NoCycles())


def test_cryptomatte_has_hand_and_scene(shot, fake_session, fake_renderer, render):
    shot.view_layers[0].use_pass_cryptomatte_object = True
    channels = render(shot)
    alpha = fake_renderer().render(fake_session.made[-1].shots[-1]).alpha
    channels = {name.lower(): values for name, values in channels.items()}  # Cycles' own are small letters
    ranks = [(channels[f"cryptoobject00.{a}"], channels[f"cryptoobject00.{b}"]) for a, b in ("rg", "ba")]
    for name, coverage in (("LiveHand Mesh", alpha), ("Wall", 1 - alpha)):
        found = sum(np.where(ids == crypto_id(name), part, 0) for ids, part in ranks)
        np.testing.assert_allclose(found, coverage, atol=1e-5)


def test_cryptomatte_of_the_hand_alone(hand_scene, fake_session, fake_renderer, render):
    hand_scene.view_layers[0].use_pass_cryptomatte_object = True
    channels = render(hand_scene)
    alpha = fake_renderer().render(fake_session.made[-1].shots[-1]).alpha
    np.testing.assert_allclose(channels["CryptoObject00.G"], alpha, atol=1e-6)
    assert (channels["CryptoObject00.R"][alpha > 0] == crypto_id("LiveHand Mesh")).all()
    assert "CryptoObject02.A" in channels


def test_a_hand_is_graded_and_keeps_its_look(hand_scene, fake_session, fake_renderer, render):
    find_hands(hand_scene)[0].livehand.exposure = 1.0
    channels = render(hand_scene)
    frame = fake_renderer().render(fake_session.made[-1].shots[-1])
    np.testing.assert_allclose(rgb(channels), 2 * frame.rgb, rtol=1e-5)
    hand_scene.view_settings.view_transform, hand_scene.livehand.keep_look = "AgX", True
    assert np.abs(rgb(render(hand_scene, "kept.exr")) - 2 * frame.rgb).max() > 0.05
