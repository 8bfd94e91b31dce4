"""Light groups as passes of a lit hand, alone and in its scene; colours brighter than 1 survive into the file."""

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.file import save_avatar
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.nerf.avatar import AvatarConfig, new_avatar
from livehand.backend.nerf.field import FieldConfig
from livehand.backend.nerf.sampler import SamplerConfig
from livehand.backend.nerf.superres import SuperResConfig
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
