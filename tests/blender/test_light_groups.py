"""Light groups as passes of a lit hand, alone and in its scene; colours brighter than 1 survive into the file."""

from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.avatar import AvatarConfig, new_avatar
from livehand.backend.avatars.file import save_avatar
from livehand.backend.field.field import FieldConfig
from livehand.backend.field.sampler import SamplerConfig
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.camera import Camera
from livehand.backend.records.frame import Frame
from livehand.backend.records.light import Lamp, Light, MeasuredLight
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.frame_task import FrameTask, HandTask
from livehand.livehand_blender.render.light_groups import grouped_frames, task_with_groups
from livehand.livehand_blender.rig.hand import find_hands

LAYER = "ViewLayer"


@pytest.fixture(scope="session")
def lit_avatar(tmp_path_factory):
    """The file of a small relightable avatar, untrained."""
    hand = load_default_hand()
    config = AvatarConfig(
        FieldConfig(width=16, planes=((32, 3, 4),), relief=8, light="linear"),
        SuperResConfig(kind="lit", width=8, depth=2),
        SamplerConfig(6, 0.003),
    )
    path = tmp_path_factory.mktemp("avatar") / "lit.livehand"
    save_avatar(new_avatar("lit", hand.name, hand.sha256, config), path)
    return path


@pytest.fixture
def grouped_scene(hand_scene, lit_avatar):
    """The hand under a sun and a world, each in a light group of its own."""
    scene = hand_scene
    find_hands(scene)[0].livehand.avatar_path = str(lit_avatar)
    scene.livehand.keep_look = False
    scene.cycles.samples, scene.cycles.use_denoising = 1, False
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    scene.render.film_transparent = False
    sun = bpy.data.objects.new("Sun", bpy.data.lights.new("Sun", "SUN"))
    sun.data.energy, sun.rotation_euler = 40.0, (0.5, 0.3, 0)
    scene.collection.objects.link(sun)
    scene.world = bpy.data.worlds.new("Grey")
    layer = scene.view_layers[0]
    for name, thing in (("Key", sun), ("Fill", scene.world)):
        layer.lightgroups.add().name = name
        thing.lightgroup = name
    return scene


@pytest.fixture
def render(tmp_path, read_exr, use_multilayer_exr):
    """A function: scene -> {pass.channel: [H, W]} of its first layer."""

    def of(scene):
        path = tmp_path / "shot.exr"
        scene.render.filepath = str(path)
        use_multilayer_exr(scene)
        bpy.ops.render.render(write_still=True)
        return {k.removeprefix(f"{LAYER}."): v for k, v in read_exr(path).items() if k.startswith(LAYER)}

    return of


def rgb(channels, name):
    return np.stack([channels[f"{name}.{c}"] for c in "RGB"], -1)


@pytest.mark.parametrize("mode", ["HAND", "SCENE"])
def test_the_groups_add_up(grouped_scene, render, mode):
    grouped_scene.livehand.mode = mode
    grouped_scene.view_layers[0].livehand.use_pass_hand = True
    channels = render(grouped_scene)
    groups = rgb(channels, "Combined_Key"), rgb(channels, "Combined_Fill")
    combined = rgb(channels, "Combined")
    is_hand = channels["HandAlpha.A"] > 0.5
    assert is_hand.sum() > 100
    np.testing.assert_allclose(sum(groups), combined, rtol=1e-4, atol=1e-6)
    assert all(group[is_hand].mean() > 1e-3 for group in groups)
    assert combined[is_hand].max() > 1.5


def even_frame(value):
    return Frame(np.full((2, 2, 3), value, np.float32), np.ones((2, 2), np.float32), np.ones((2, 2), np.float32))


def lit_hand(light):
    """A hand of which the renderer shows the strength of its lamps, twice that where the light was measured."""

    def render(shot, should_stop):
        strength = sum(float(lamp.rgb[0]) for lamp in shot.light.lamps)
        return even_frame(strength * (2 if shot.light.measured else 1))

    camera = Camera(np.eye(3), np.eye(4), (2, 2))
    facts = {"hand": load_default_hand(), "is_relightable": True, "mean_albedo": None}
    facts |= {"frames_at_once": 1, "renders_at_once": False}
    avatar = SimpleNamespace(name="even", provenance={})
    renderer = SimpleNamespace(render=render, posed_surface=lambda shot: None, avatar=avatar, **facts)
    return HandTask(renderer, Shot(HandPose.rest(), np.zeros((1, 3)), camera, light))


def test_measured_light_is_shared_in_the_groups_proportion():
    lamps = tuple(Lamp("sun", np.full(3, value), group=group) for value, group in ((3, "Key"), (1, "Fill"), (0.5, "")))
    measured = MeasuredLight(np.ones((2, 2, 3)), np.ones((2, 2, 3)), np.ones((2, 2)))
    task = FrameTask(((lit_hand(Light(lamps, measured=measured)), lit_hand(Light(lamps[:1]))),))
    names = ("Key", "Fill", "Unused")
    frames = grouped_frames(task, names, task_with_groups(task, names).run(lambda: False))
    both = {name: [float(frame.rgb.mean()) for frame in samples[0]] for name, samples in frames.groups.items()}
    assert [float(frame.rgb.mean()) for frame in frames.samples[0]] == [9, 3]
    assert both == {"Key": [6, 3], "Fill": [2, 0], "Unused": [0, 0]}


def test_measured_light_where_no_lamp_shines_is_shared_evenly():
    lamps = tuple(Lamp("sun", np.zeros(3), group=group) for group in ("Key", "Fill"))
    task = FrameTask(((lit_hand(Light(lamps)),),))
    frames = grouped_frames(task, ("Key", "Fill"), ((even_frame(1.0), even_frame(0.0), even_frame(0.0)),))
    assert [samples[0][0].rgb.mean() for samples in frames.groups.values()] == [0.5, 0.5]


def test_without_groups_nothing_is_rendered_twice():
    task = FrameTask(((lit_hand(Light((Lamp("sun", np.ones(3)),))),),))
    assert task_with_groups(task, ()) is task


def test_an_unlit_hand_belongs_to_no_group():
    task = FrameTask(((lit_hand(None),),))
    assert len(task_with_groups(task, ("Key",)).samples[0]) == 1
    frames = grouped_frames(task, ("Key",), ((even_frame(1.0),),))
    assert frames.groups["Key"][0][0].rgb.max() == 0
    assert frames.groups["Key"][0][0].alpha.min() == 1


def test_bright_colours_survive_a_grade(grouped_scene, render):
    """A stop more doubles the hand in every group; a bias is in Combined alone."""
    before = render(grouped_scene)
    hand = find_hands(grouped_scene)[0].livehand
    hand.exposure, hand.bias = 1.0, (0.25, 0.0, 0.0)
    after = render(grouped_scene)
    for name in ("Combined_Key", "Combined_Fill"):
        np.testing.assert_allclose(rgb(after, name), 2 * rgb(before, name), rtol=1e-5, atol=1e-7)
    expected = 2 * rgb(before, "Combined") + before["Combined.A"][..., None] * np.array([0.25, 0, 0])
    np.testing.assert_allclose(rgb(after, "Combined"), expected, rtol=1e-5, atol=1e-6)
