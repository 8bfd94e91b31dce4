"""An exported, textured hand in Cycles against LiveHand's frame of it, in the same light."""

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.motion.writers.writer import WriteOptions
from livehand.livehand_blender.motion.taking import sample_take
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import write_theta
from livehand.livehand_blender.rigs.blender_writers import BLENDER_WRITERS
from PIL import Image

pytestmark = pytest.mark.nightly
GLTF = next(writer for writer in BLENDER_WRITERS if writer.name == "gltf")
LEAST_DB = 26
"""Over all pixels that show the hand in either picture, outlines too."""


def rendered(scene, path):
    """[H, W, 4] encoded colours on black, and alpha."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    pixels = np.asarray(Image.open(path).convert("RGBA")) / 255.0
    return np.concatenate([pixels[..., :3] * pixels[..., 3:], pixels[..., 3:]], -1)


def posed_scene(skin, gesture):
    bpy.ops.livehand.new_hand_scene()
    scene = bpy.context.scene
    (hand,) = RiggedHand.all_in(scene)
    hand.armature.livehand.avatar_path = str(shipped_avatar_path(skin))
    hand.armature.livehand.hair = 0
    write_theta(hand, theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand()))
    scene.livehand.mode = "HAND"
    scene.frame_start = scene.frame_end = scene.frame_current = 1
    scene.render.resolution_x, scene.render.resolution_y, scene.render.resolution_percentage = 384, 512, 100
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Standard"
    scene.render.image_settings.color_mode = "RGBA"
    return scene, hand


@pytest.mark.parametrize(("skin", "gesture"), [("light", "relaxed"), ("light", "fist"), ("deep", "spread")])
def test_a_textured_hand_in_cycles_looks_like_our_frame(registered, tmp_path, skin, gesture):
    scene, hand = posed_scene(skin, gesture)
    ours = rendered(scene, tmp_path / "ours.png")
    take = sample_take(bpy.context, [hand], range(1, 2))
    GLTF.write(take, tmp_path / "hand.glb", WriteOptions(avatars={"right": shipped_avatar_path(skin)}, texture_px=2048))
    for thing in (hand.armature, *hand.armature.children_recursive):
        thing.hide_render = True
    before = set(scene.objects)
    bpy.ops.import_scene.gltf(filepath=str(tmp_path / "hand.glb"))
    for thing in set(scene.objects) - before:
        thing.hide_render = "Hand" not in thing.name  # the shape of the importer's bones
    scene.frame_set(0)
    scene.render.engine, scene.cycles.samples = "CYCLES", 64
    theirs = rendered(scene, tmp_path / "cycles.png")
    shown = np.maximum(ours[..., 3], theirs[..., 3]) > 0
    assert shown.mean() > 0.1
    found_db = -10 * np.log10(((ours - theirs)[..., :3][shown] ** 2).mean())
    assert found_db >= LEAST_DB, found_db
