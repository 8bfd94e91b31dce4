"""Compositor set-ups: rendered pixels against the closed form of over, and nodes that must be kept."""

import bpy
import cv2
import numpy as np
import pytest
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.compositing.image_files import ImageFiles
from livehand.livehand_blender.compositing.tree import compositor_of, output_input, used_compositors
from PIL import Image

SIZE = (48, 64)
HALF = {"rtol": 5e-4, "atol": 5e-6}  # the compositor stores 8-bit images as half floats


def linear(srgb):
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def over(front, back):
    """Premultiplied RGBA [H, W, 4]."""
    return front + (1 - front[..., 3:]) * back


def composite(scene, path, read_exr, frame=1):
    """[H, W, 4] float, the compositor's result for a frame."""
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode = "OPEN_EXR", "RGBA"
    settings.color_depth, settings.exr_codec = "32", "ZIP"
    scene.frame_set(frame)
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    channels = read_exr(path)
    return np.stack([channels[name] for name in "RGBA"], -1)


def as_array(frame):
    return np.concatenate([frame.rgb, frame.alpha[..., None]], -1)


@pytest.fixture
def wall_scene(hand_scene):
    """Another scene of the same size and camera: a wall of known radiance, left half in front of the hand."""
    hand_scene.camera.location.x = load_default_hand().v_template[:, 0].mean()
    scene = bpy.data.scenes.new("Wall")
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 1, False
    scene.camera = hand_scene.camera
    scene.collection.objects.link(scene.camera)
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    material = bpy.data.materials.new("Light")
    if material.node_tree is None:  # Blender 5 creates it by itself, and warns
        material.use_nodes = True
    nodes = material.node_tree.nodes
    nodes.clear()
    light, out = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeOutputMaterial")
    light.inputs["Color"].default_value = (0.2, 0.4, 0.8, 1)
    material.node_tree.links.new(light.outputs[0], out.inputs["Surface"])
    x, y, _ = scene.camera.location
    for sign, z in ((-1, 0.2), (1, -0.2)):
        mesh = bpy.data.meshes.new("Wall")
        corners = [(x, y - 1, z), (x + sign, y - 1, z), (x + sign, y + 1, z), (x, y + 1, z)]
        mesh.from_pydata(corners, [], [(0, 1, 2, 3)])
        mesh.materials.append(material)
        scene.collection.objects.link(bpy.data.objects.new("Wall", mesh))
    return scene


def test_the_hand_is_composited_by_depth(hand_scene, wall_scene, fake_session, read_exr, tmp_path):
    assert bpy.ops.livehand.setup_compositing(behind="Wall") == {"FINISHED"}
    got = composite(hand_scene, tmp_path / "over.exr", read_exr)
    (renderer,) = fake_session.made
    hand = as_array(renderer.render(renderer.shots[-1]))
    wall = np.broadcast_to(np.float32([0.2, 0.4, 0.8, 1]), got.shape)
    is_near_wall = np.arange(SIZE[0])[None, :, None] < SIZE[0] // 2
    assert hand[:, : SIZE[0] // 2, 3].max() == hand[:, SIZE[0] // 2 :, 3].max() == 1
    soft = (hand[..., 3] > 0) & (hand[..., 3] < 1)
    assert soft[:, SIZE[0] // 2 + 1 :].any()
    expected = np.where(is_near_wall, wall, over(hand, wall))
    middle = slice(SIZE[0] // 2 - 1, SIZE[0] // 2 + 1)  # Cycles' pixel filter blurs the wall's edge
    np.testing.assert_allclose(np.delete(got, middle, 1), np.delete(expected, middle, 1), atol=2e-5)


def test_without_a_scene_behind_the_render_is_the_hand(hand_scene, fake_session, read_exr, tmp_path):
    bpy.ops.livehand.setup_compositing()
    got = composite(hand_scene, tmp_path / "alone.exr", read_exr)
    (renderer,) = fake_session.made
    np.testing.assert_allclose(got, as_array(renderer.render(renderer.shots[-1])), atol=1e-6)


@pytest.mark.parametrize(
    ("name", "message"), [("Nowhere", "no scene 'Nowhere'"), ("Scene", "own scene"), ("Wall", "same size")]
)
def test_an_invalid_scene_behind_is_rejected(hand_scene, wall_scene, name, message):
    wall_scene.render.resolution_x = 50
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.livehand.setup_compositing(behind=name)


def hand_picture(frame):
    """[H, W, 4] straight sRGB levels of a frame: soft alpha, and another colour for each frame."""
    rng = np.random.default_rng(frame)
    return rng.integers(0, 256, (SIZE[1], SIZE[0], 4)).astype(np.uint8)


def premultiplied(levels):
    alpha = levels[..., 3:] / 255
    return np.concatenate([linear(levels[..., :3] / 255) * alpha, alpha], -1)


def plate_picture(frame):
    rng = np.random.default_rng(1000 + frame)
    return rng.integers(0, 256, (SIZE[1], SIZE[0], 3)).astype(np.uint8)


def opaque(levels):
    return np.concatenate([linear(levels / 255), np.ones((*levels.shape[:2], 1))], -1)


def save_float_image(rgba, path, multilayer):
    """Blender's own EXR of premultiplied linear RGBA, rendered by the compositor."""
    scene = bpy.data.scenes.new("Writer")
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    image = bpy.data.images.new("Pixels", *SIZE, alpha=True, float_buffer=True)
    image.alpha_mode = "PREMUL"
    image.pixels.foreach_set(np.ascontiguousarray(rgba[::-1], np.float32).ravel())
    tree = compositor_of(scene)
    node = tree.nodes.new("CompositorNodeImage")
    node.image = image
    tree.links.new(node.outputs["Image"], output_input(tree))
    settings = scene.render.image_settings
    if hasattr(settings, "media_type") and multilayer:
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER" if multilayer else "OPEN_EXR"
    settings.color_mode, settings.color_depth = "RGBA", "32"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True, scene=scene.name)
    bpy.data.scenes.remove(scene)
    bpy.data.images.remove(image)


@pytest.fixture
def empty_scene():
    scene = bpy.context.scene
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    return scene


@pytest.fixture
def plates(tmp_path):
    """Numbered plates 4 to 7."""
    folder = tmp_path / "plates"
    folder.mkdir()
    for frame in range(4, 8):
        Image.fromarray(plate_picture(frame)).save(folder / f"plate.{frame:03d}.png")
    return folder


@pytest.fixture(params=["png", "exr", "multilayer"])
def hands(request, tmp_path):
    """Frames 5, 6 and 8 of a hand, as finished files."""
    folder = tmp_path / "hands"
    folder.mkdir()
    for frame in (5, 6, 8):
        if request.param == "png":
            Image.fromarray(hand_picture(frame)).save(folder / f"wave_{frame:04d}.png")
        else:
            path = folder / f"wave_{frame:04d}.exr"
            save_float_image(premultiplied(hand_picture(frame)), path, request.param == "multilayer")
    return next(folder.glob("wave_0006.*"))


def expected_over(hand_frame, plate_frame):
    return over(premultiplied(hand_picture(hand_frame)), opaque(plate_picture(plate_frame)))


def test_each_frame_is_over_the_plate_of_its_number(empty_scene, hands, plates, read_exr, tmp_path):
    bpy.ops.livehand.load_sequence_over_plate(filepath=str(hands), plate_path=str(plates / "plate.005.png"))
    for frame in (5, 6):
        got = composite(empty_scene, tmp_path / f"{frame}.exr", read_exr, frame)
        np.testing.assert_allclose(got, expected_over(frame, frame), **HALF)


def test_the_plate_can_be_delayed_or_a_still(empty_scene, hands, plates, read_exr, tmp_path):
    plate = {"plate_path": str(plates / "plate.004.png")}
    bpy.ops.livehand.load_sequence_over_plate(filepath=str(hands), plate_delay=2, **plate)
    got = composite(empty_scene, tmp_path / "late.exr", read_exr, frame=8)
    np.testing.assert_allclose(got, expected_over(8, 6), **HALF)
    bpy.ops.livehand.load_sequence_over_plate(filepath=str(hands), plate_is_still=True, **plate)
    got = composite(empty_scene, tmp_path / "still.exr", read_exr, frame=8)
    np.testing.assert_allclose(got, expected_over(8, 4), **HALF)


def test_the_last_frame_remains_after_the_sequence(empty_scene, hands, plates, read_exr, tmp_path):
    bpy.ops.livehand.load_sequence_over_plate(filepath=str(hands), plate_path=str(plates / "plate.004.png"))
    got = composite(empty_scene, tmp_path / "late.exr", read_exr, frame=20)
    np.testing.assert_allclose(got, expected_over(8, 7), **HALF)


@pytest.mark.skipif(bpy.app.version < (4, 5), reason="there, a missing picture is black or pink")
@pytest.mark.parametrize("frame", [4, 7])
def test_the_plate_is_visible_where_frames_are_missing(empty_scene, hands, plates, read_exr, tmp_path, frame):
    bpy.ops.livehand.load_sequence_over_plate(filepath=str(hands), plate_path=str(plates / "plate.004.png"))
    got = composite(empty_scene, tmp_path / "gap.exr", read_exr, frame)
    np.testing.assert_allclose(got, opaque(plate_picture(frame)), **HALF)


def test_a_sequence_is_the_files_of_one_name(tmp_path):
    for name in ("v2_0009.png", "v2_0010.png", "v2_0012.png", "v3_0001.png", "v2_0001.exr", "v2_0100.png.txt", "a.png"):
        (tmp_path / name).touch()
    found = ImageFiles.find(tmp_path / "v2_0010.png")
    assert found == ImageFiles(tmp_path / "v2_0009.png", "SEQUENCE", 9, 12)
    for alone in ("v3_0001.png", "a.png"):
        assert ImageFiles.find(tmp_path / alone) == ImageFiles(tmp_path / alone, "FILE")
    assert ImageFiles.find(tmp_path / "v2_0010.png", is_still=True).source == "FILE"


def test_a_clip_can_be_the_plate(empty_scene, hands, plates, read_exr, tmp_path):
    clip = bpy.data.movieclips.load(str(plates / "plate.004.png"))
    clip.frame_start = 4
    empty_scene.active_clip = clip
    bpy.ops.livehand.load_sequence_over_plate(filepath=str(hands))
    got = composite(empty_scene, tmp_path / "clip.exr", read_exr, frame=5)
    np.testing.assert_allclose(got, expected_over(5, 5), **HALF)


def test_a_movie_starts_at_frame_1(empty_scene, read_exr, tmp_path):
    movie = cv2.VideoWriter(str(tmp_path / "plate.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 24, SIZE)
    for level in (40, 120, 200):
        movie.write(np.full((SIZE[1], SIZE[0], 3), level, np.uint8))
    movie.release()
    clear = np.zeros((SIZE[1], SIZE[0], 4), np.uint8)
    Image.fromarray(clear).save(tmp_path / "clear.png")
    paths = {"filepath": str(tmp_path / "clear.png"), "plate_path": str(tmp_path / "plate.avi")}
    bpy.ops.livehand.load_sequence_over_plate(**paths)
    for frame, level in ((1, 40), (2, 120), (3, 200)):
        got = composite(empty_scene, tmp_path / f"{frame}.exr", read_exr, frame)
        np.testing.assert_allclose(got[..., :3], linear(np.float64(level / 255)), atol=0.02)
    bpy.ops.livehand.load_sequence_over_plate(plate_delay=10, **paths)
    got = composite(empty_scene, tmp_path / "late.exr", read_exr, frame=12)
    np.testing.assert_allclose(got[..., :3], linear(np.float64(120 / 255)), atol=0.02)


@pytest.mark.parametrize(
    ("hand", "plate", "message"),
    [
        ("nowhere.exr", "plates/plate.004.png", "no image at"),
        ("plates/plate.004.png", "", "a plate is needed"),
        ("hand.jpg", "plates/plate.004.png", "must be EXR or PNG"),
        ("plates/plate.004.png", "nowhere.png", "no image at"),
    ],
)
def test_unreadable_files_are_rejected_and_add_no_nodes(empty_scene, plates, tmp_path, hand, plate, message):
    Image.fromarray(plate_picture(1)).save(tmp_path / "hand.jpg")
    plate_path = str(tmp_path / plate) if plate else ""
    with pytest.raises(RuntimeError, match=message):
        bpy.ops.livehand.load_sequence_over_plate(filepath=str(tmp_path / hand), plate_path=plate_path)
    assert not any(group.bl_idname == "CompositorNodeTree" for group in bpy.data.node_groups)
    assert getattr(empty_scene, "node_tree", None) is None


@pytest.fixture
def users_tree(hand_scene):
    """A tree with an image of the user's own at the output."""
    tree = compositor_of(hand_scene)
    tree.nodes.clear()
    node = tree.nodes.new("CompositorNodeRGB")
    tree.links.new(node.outputs[0], output_input(tree))
    return tree


def shape_of(tree):
    """Everything in which two node trees can differ, except names."""
    nodes = sorted((node.bl_idname, node.label, tuple(node.location)) for node in tree.nodes)
    ends = ((link.from_node, link.from_socket, link.to_node, link.to_socket) for link in tree.links)
    links = sorted((a.bl_idname, output.name, b.bl_idname, socket.name) for a, output, b, socket in ends)
    return nodes, links


def test_a_plain_render_at_the_output_is_replaced(hand_scene, wall_scene):
    """With *Use Nodes* Blender connects one, on whose place the button is pressed."""
    tree = compositor_of(hand_scene)
    tree.nodes.clear()
    render, reroute = tree.nodes.new("CompositorNodeRLayers"), tree.nodes.new("NodeReroute")
    tree.links.new(render.outputs["Image"], reroute.inputs[0])
    tree.links.new(reroute.outputs[0], output_input(tree))
    bpy.ops.livehand.setup_compositing(behind="Wall")
    assert output_input(tree).links[0].from_node.bl_idname == "CompositorNodeAlphaOver"
    tree.links.new(render.outputs["Alpha"], output_input(tree))  # the user's own choice
    bpy.ops.livehand.setup_compositing(behind="Wall")
    assert output_input(tree).links[0].from_node == render


def test_the_users_nodes_keep_the_output_until_replaced(users_tree):
    before = {node.name: tuple(node.location) for node in users_tree.nodes}
    bpy.ops.livehand.setup_compositing()
    assert output_input(users_tree).links[0].from_node.bl_idname == "CompositorNodeRGB"
    assert before.items() <= {node.name: tuple(node.location) for node in users_tree.nodes}.items()
    bpy.ops.livehand.setup_compositing(replace_output=True)
    assert output_input(users_tree).links[0].from_node.bl_idname == "CompositorNodeRLayers"
    assert before.items() <= {node.name: tuple(node.location) for node in users_tree.nodes}.items()


def test_repeating_the_set_up_changes_nothing(hand_scene, wall_scene):
    bpy.ops.livehand.setup_compositing(behind="Wall")
    once = shape_of(compositor_of(hand_scene))
    bpy.ops.livehand.setup_compositing(behind="Wall")
    assert shape_of(compositor_of(hand_scene)) == once
    assert [node.bl_idname for node in compositor_of(hand_scene).nodes].count("NodeFrame") == 1


def test_links_from_the_result_are_restored(users_tree, wall_scene):
    bpy.ops.livehand.setup_compositing()
    (ours,) = (node for node in users_tree.nodes if node.bl_idname == "CompositorNodeRLayers")
    blur = users_tree.nodes.new("CompositorNodeBlur")
    blur.parent = ours.parent
    users_tree.links.new(ours.outputs["Image"], blur.inputs["Image"])
    bpy.ops.livehand.setup_compositing(behind="Wall")
    assert blur.inputs["Image"].links[0].from_node.bl_idname == "CompositorNodeAlphaOver"


def test_both_set_ups_can_coexist(hand_scene, plates):
    bpy.ops.livehand.setup_compositing()
    plate = str(plates / "plate.004.png")
    bpy.ops.livehand.load_sequence_over_plate(filepath=plate, plate_path=plate)
    tree = compositor_of(hand_scene)
    frames = [node for node in tree.nodes if node.bl_idname == "NodeFrame"]
    assert len(frames) == 2
    assert abs(frames[0].location.y - frames[1].location.y) > 300
    assert output_input(tree).links[0].from_node.bl_idname == "CompositorNodeRLayers"


def test_undo_removes_the_nodes(users_tree):
    bpy.ops.ed.undo_push(message="Before")
    bpy.ops.livehand.setup_compositing("EXEC_DEFAULT", True)
    scene = bpy.context.scene
    assert len(compositor_of(scene).nodes) == 4
    bpy.ops.ed.undo()
    assert len(compositor_of(bpy.context.scene).nodes) == 2


def test_the_nodes_that_a_render_passes_through_are_found(empty_scene):
    assert used_compositors(empty_scene) == []
    tree = compositor_of(empty_scene)
    assert compositor_of(empty_scene) == tree
    assert used_compositors(empty_scene) == [tree]
    empty_scene.render.use_compositing = False
    assert used_compositors(empty_scene) == []


@pytest.mark.skipif(not hasattr(bpy.types, "SceneCompositorEffect"), reason="scenes have effects since Blender 5.3")
def test_each_effect_that_renders_is_among_them_and_a_set_up_turns_its_own_on(empty_scene):
    tree = compositor_of(empty_scene)
    (first,) = empty_scene.compositor_effects
    second = empty_scene.compositor_effects.new("Second")
    assert used_compositors(empty_scene) == [tree]  # the second has no nodes yet
    second.node_group = other = bpy.data.node_groups.new("Second", "CompositorNodeTree")
    assert used_compositors(empty_scene) == [tree, other]
    first.enable_for_render = False
    assert used_compositors(empty_scene) == [other]
    empty_scene.compositor_effects.active = first
    assert compositor_of(empty_scene) == tree
    assert used_compositors(empty_scene) == [tree, other]
