"""A texture on the plain mesh: what Cycles shows of it, against the backend's drawing, and what is refused."""

import bpy
import numpy as np
import pytest
import torch
from livehand.backend.capture.picture import linear_to_srgb
from livehand.backend.field.rays import camera_tensors
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.geometry.uvh import interpolate
from livehand.backend.hand.topology import topology_of
from livehand.backend.records.errors import LiveHandError
from livehand.backend.research.baselines.mesh_wrapping import as_picture
from livehand.backend.research.baselines.texture import dilated, draw_textured, texels_of
from livehand.livehand_blender.hands.shot import world_vertices
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand, find_hands
from livehand.livehand_blender.rig.skin_texture import remove_texture, wear_texture, worn_texture
from livehand.livehand_blender.scene.camera import read_camera
from PIL import Image


@pytest.fixture
def hand(hand_scene):
    return RiggedHand.of(find_hands(hand_scene)[0])


@pytest.fixture
def picture(tmp_path):
    path = tmp_path / "skin.png"
    Image.new("RGB", (8, 8), (200, 30, 90)).save(path)
    return path


@pytest.fixture
def shader(hand):
    return next(n for n in hand.mesh.active_material.node_tree.nodes if n.type == "BSDF_PRINCIPLED")


@pytest.mark.parametrize("side", ["right", "left"])
def test_cycles_shows_the_atlas_as_the_backend_draws_it(hand_scene, hand, side, use_multilayer_exr, read_exr, tmp_path):
    """Where skin faces the camera, away from outlines, which Cycles filters otherwise."""
    if side == "left":
        left = hand.model.for_side("left")
        for thing in (hand.mesh, hand.armature):
            bpy.data.objects.remove(thing)
        hand = RiggedHand.of(add_hand(bpy.context, left))
    topology = topology_of(hand.model, canonical_side="right")
    mesh = posed_mesh(topology, torch.as_tensor(world_vertices(hand.mesh), dtype=torch.float32))
    texels = texels_of(topology, 512)
    place = interpolate(mesh.vertices, topology, texels.samples)
    texture = dilated(texels.texel, (0.5 + 0.4 * torch.sin(60 * place)).contiguous(), 512)
    Image.fromarray(as_picture(texture)).save(tmp_path / "skin.png")
    wear_texture(hand, tmp_path / "skin.png")
    hand.mesh.active_material.node_tree.nodes["Principled BSDF"].inputs["Specular IOR Level"].default_value = 0
    hand_scene.render.engine = "CYCLES"
    hand_scene.cycles.samples, hand_scene.cycles.use_denoising = 16, False
    hand_scene.view_layers[0].use_pass_diffuse_color = True
    hand_scene.render.resolution_x, hand_scene.render.resolution_y = 192, 256
    use_multilayer_exr(hand_scene)
    hand_scene.render.filepath = str(tmp_path / "cycles.exr")
    bpy.ops.render.render(write_still=True)
    channels = read_exr(tmp_path / "cycles.exr")
    name = next(name for name in ("DiffCol", "Diffuse Color") if f"ViewLayer.{name}.R" in channels)  # from 5.0 on
    shown = linear_to_srgb(np.stack([channels[f"ViewLayer.{name}.{c}"] for c in "RGB"]))
    camera = camera_tensors(read_camera(hand_scene.camera, hand_scene.render), "cpu")
    expected = draw_textured(texture, mesh, topology, camera)[0].numpy()
    inside = (expected[3] == 1) & (channels["ViewLayer.Combined.A"] > 0.999)
    assert inside.sum() > 1500
    off = np.abs(shown - expected[:3])[:, inside]
    assert np.median(off) < 0.005
    assert np.quantile(off, 0.9) < 0.03
    assert np.ptp(np.quantile(expected[:3][:, inside], [0.1, 0.9])) > 0.4


def test_it_is_worn_replaced_and_taken_off(hand, shader, picture, tmp_path):
    plain = tuple(shader.inputs["Base Color"].default_value)
    other = tmp_path / "other.png"
    Image.new("RGB", (4, 4), (10, 20, 30)).save(other)
    wear_texture(hand, picture)
    assert worn_texture(hand.mesh).name == "skin.png"
    wear_texture(hand, other)
    assert worn_texture(hand.mesh).name == "other.png"
    assert sum(node.type == "TEX_IMAGE" for node in shader.id_data.nodes) == 1
    assert shader.inputs["Base Color"].links[0].from_node.image.name == "other.png"
    remove_texture(hand)
    remove_texture(hand)
    assert worn_texture(hand.mesh) is None
    assert not shader.inputs["Base Color"].is_linked
    assert tuple(shader.inputs["Base Color"].default_value) == plain


def test_a_file_that_has_changed_is_read_again(hand, picture):
    wear_texture(hand, picture)
    Image.new("RGB", (8, 8), (0, 255, 0)).save(picture)
    wear_texture(hand, picture)
    np.testing.assert_allclose(worn_texture(hand.mesh).pixels[:4], [0, 1, 0, 1], atol=1e-6)


def test_what_is_no_picture_changes_nothing(hand, picture, tmp_path):
    wear_texture(hand, picture)
    (tmp_path / "text.png").write_text("no picture")
    images = set(bpy.data.images)
    for path, words in ((tmp_path / "text.png", "text.png is none"), (tmp_path / "gone.png", "there is none at")):
        with pytest.raises(LiveHandError, match=words):
            wear_texture(hand, path)
    assert worn_texture(hand.mesh).name == "skin.png"
    assert set(bpy.data.images) == images


def test_materials_that_cannot_wear_one_are_named(hand, shader, picture):
    shader.id_data.nodes.remove(shader)
    with pytest.raises(LiveHandError, match="must have a Principled BSDF"):
        wear_texture(hand, picture)
    hand.mesh.data.materials.clear()
    with pytest.raises(LiveHandError, match="must have a material with nodes"):
        wear_texture(hand, picture)


def test_the_operators_wear_and_undo(registered, hand, picture):
    bpy.context.view_layer.objects.active = hand.armature
    assert bpy.ops.livehand.wear_texture(filepath=str(picture)) == {"FINISHED"}
    assert worn_texture(hand.mesh).name == "skin.png"
    assert bpy.ops.livehand.remove_texture() == {"FINISHED"}
    assert worn_texture(hand.mesh) is None
    with pytest.raises(RuntimeError, match="there is none at"):
        bpy.ops.livehand.wear_texture(filepath=str(picture.with_name("gone.png")))
