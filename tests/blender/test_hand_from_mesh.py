"""A hand model is made from another rig's mesh, captured with its own materials, trained, and rendered in Blender."""

import hashlib
import json
from pathlib import Path

import bmesh
import bpy
import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.capture.capture import load_capture
from livehand.backend.capture.plan import CapturePlan
from livehand.backend.commands.inspect import inspect
from livehand.backend.evaluation.metrics import alpha_iou
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_quaternion
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model import PARENTS
from livehand.backend.hand.model_file import builtin_hand_path, load_default_hand, load_hand_model
from livehand.backend.motion.formats.own import write_motion
from livehand.backend.motion.motion import HandMotion
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.rigs.hand_from_mesh.hand_model import make_hand_model
from livehand.livehand_blender.capture.own_surface import OwnSurface
from livehand.livehand_blender.capture.scene import capture_scene, set_camera
from livehand.livehand_blender.capture.skin import SkinTone
from livehand.livehand_blender.cli import main
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand, mesh_of
from livehand.livehand_blender.rig.pose import write_theta, write_transl
from livehand.livehand_blender.rigs.follow import follow
from livehand.livehand_blender.rigs.hand_from_mesh import hand_model_from_mesh, mesh_skinned_to
from livehand.livehand_blender.rigs.pictures import find_pictures, is_missing
from livehand.livehand_blender.rigs.rest_mesh import read_rest_mesh
from livehand.livehand_blender.rigs.source import SourceRig, read_skeleton
from livehand.livehand_blender.scene.settings import use_livehand
from mathutils import Matrix
from PIL import Image

SIZE = (64, 96)


@pytest.fixture(scope="module")
def coarse(other_rigs):
    """The other rig with fewer vertices, so that its atlas is computed in a second."""
    names = other_rigs.make_rigged_hand.__globals__
    voxel_m = names["_VOXEL_M"]
    names["_VOXEL_M"] = 0.005
    yield other_rigs
    names["_VOXEL_M"] = voxel_m


@pytest.fixture(scope="module")
def files(coarse, registered, tmp_path_factory):
    """`right.glb` and `left.glb`, and the hand models that `livehand make-hand` makes from them."""
    folder = tmp_path_factory.mktemp("own")
    for side, name in (("right", "mine.npz"), ("left", "mine_left.npz")):
        bpy.ops.wm.read_homefile(use_empty=True)
        coarse.write_glb(coarse.make_rigged_hand(side), folder / f"{side}.glb")
        assert main(["make-hand", str(folder / f"{side}.glb"), "-o", str(folder / name)]) == 0
    return folder


@pytest.fixture(scope="module")
def trained(files):
    """A small capture of the right hand, and an avatar after a few training steps."""
    hand, capture, avatar = (str(files / name) for name in ("mine.npz", "capture", "mine.safetensors"))
    few = "--poses 6 --cameras 5 --cameras-per-pose 3 --size 64x96 --samples 2 --eval-samples 4 --eval-views 1"
    assert main(["capture", "--hand", hand, "-o", capture, *few.split(), "--threads", "1"]) == 0
    quick = "--steps 60 --perceptual 0 --preview-minutes 0 --device cpu"
    assert main(["train", capture, "--hand", hand, "-o", avatar, *quick.split()]) == 0
    return files / "capture", files / "mine.safetensors"


def test_the_file_records_its_provenance(files):
    with np.load(files / "mine.npz") as arrays:
        provenance = json.loads(str(arrays["provenance"]))
    assert provenance["source"] == "right.glb"
    assert provenance["source_sha256"] == hashlib.sha256((files / "right.glb").read_bytes()).hexdigest()
    assert provenance["bones"][:2] == ["wrist", "index-finger-phalanx-proximal"]
    assert inspect(files / "mine.npz")["provenance"] == provenance
    assert "provenance" not in inspect(builtin_hand_path())


@pytest.mark.parametrize(("side", "name"), [("right", "mine.npz"), ("left", "mine_left.npz")])
def test_the_model_is_posed_as_the_rig_poses_its_mesh(files, coarse, side, name):
    """Compared where the weights agree: not at the stump, which the rig moves partly with the forearm."""
    model = load_hand_model(files / name)
    assert model.side == side
    armature = coarse.read_file(files / f"{side}.glb")
    joint_map = coarse.make_rigged_hand.__globals__["JointMap"](side, coarse.JOINTS)
    mesh = mesh_skinned_to(armature, joint_map)
    skeleton = read_skeleton(armature)
    rest = read_rest_mesh(bpy.context, mesh, armature, skeleton)
    made = make_hand_model(rest.surface, skeleton, joint_map)
    np.testing.assert_allclose(made.arrays["v_template"], model.v_template, atol=1e-12)
    of_forearm = rest.surface.weights[:, skeleton.index(coarse.FOREARM)] / rest.surface.weights.sum(1)
    agreeing = of_forearm[made.cut.source] < 1e-6
    assert agreeing.mean() > 0.8
    rng = np.random.default_rng(5)
    for _ in range(3):
        theta = rng.normal(size=(16, 3)) * 0.4
        transl = turn_bones_as(theta, armature, joint_map, made.world2template, model)
        posed = posed_vertices(model, HandPose(theta, np.zeros(10), transl, side))
        there = evaluated_world_vertices(mesh)[made.cut.source]
        carried = there @ made.world2template[:3, :3].T + made.world2template[:3, 3]
        error_mm = 1e3 * np.linalg.norm(posed - carried, axis=1)
        assert error_mm[agreeing].max() < 0.02


def test_the_hand_follows_its_source_rig_exactly(files, coarse):
    """The rig deforms its own mesh and ours follows by constraints: corresponding vertices must coincide."""
    model = load_hand_model(files / "mine.npz")
    armature = coarse.read_file(files / "right.glb")
    joint_map = coarse.make_rigged_hand.__globals__["JointMap"]("right", coarse.JOINTS)
    mesh = mesh_skinned_to(armature, joint_map)
    skeleton = read_skeleton(armature)
    rest = read_rest_mesh(bpy.context, mesh, armature, skeleton)
    made = make_hand_model(rest.surface, skeleton, joint_map)
    of_forearm = rest.surface.weights[:, skeleton.index(coarse.FOREARM)] / rest.surface.weights.sum(1)
    agreeing = of_forearm[made.cut.source] < 1e-6
    ours = add_hand(bpy.context, model, str(files / "mine.npz"))
    ours.location = (0.3, -0.2, 0.1)
    bpy.context.view_layer.update()
    follow(bpy.context, RiggedHand.of(ours), SourceRig(armature, joint_map))
    rng = np.random.default_rng(6)
    for _ in range(3):
        turn_bones_as(rng.normal(size=(16, 3)) * 0.4, armature, joint_map, made.world2template, model)
        there = evaluated_world_vertices(mesh)[made.cut.source]
        error_mm = 1e3 * np.linalg.norm(evaluated_world_vertices(mesh_of(ours)) - there, axis=1)
        assert error_mm[agreeing].max() < 0.05


def turn_bones_as(theta, armature, joint_map, world2template, model):
    """Rotate a rig's bones by theta in the template's frame; returns the hand's transl there."""
    to_template = world2template[:3, :3] @ np.array(armature.matrix_world.to_3x3().normalized())
    for name, turn in zip(joint_map.bones, axis_angle_to_matrix(theta), strict=True):
        bone = armature.pose.bones[name]
        bone.rotation_mode = "QUATERNION"
        frame = to_template @ np.array(bone.bone.matrix_local.to_3x3(), np.float64)
        above = frame.T @ turn @ frame
        bone.rotation_quaternion = matrix_to_quaternion(above)
    bpy.context.view_layer.update()
    wrist = np.array(armature.matrix_world @ armature.pose.bones[joint_map.bones[0]].head)
    return world2template[:3, :3] @ wrist + world2template[:3, 3] - model.joints[0]


def evaluated_world_vertices(mesh):
    evaluated = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    local = np.array([vertex.co for vertex in evaluated.to_mesh().vertices], np.float64)
    matrix = np.array(evaluated.matrix_world)
    return local @ matrix[:3, :3].T + matrix[:3, 3]


def test_the_posed_look_is_the_renderers_mesh(files):
    model = load_hand_model(files / "mine.npz")
    capture_scene()
    surface = OwnSurface.of_materials(model, files / "mine.blend")
    rng = np.random.default_rng(2)
    for _ in range(2):
        pose = HandPose(rng.normal(size=(16, 3)) * 0.5, np.zeros(10), rng.normal(size=3) * 0.1, "right")
        surface.set_pose(pose)
        bpy.context.view_layer.update()
        np.testing.assert_allclose(evaluated_world_vertices(surface.object), posed_vertices(model, pose), atol=1e-6)
    faces = [tuple(polygon.vertices) for polygon in surface.object.data.polygons]
    corners = {frozenset(face) for face in faces}
    assert all(any(set(face) <= set(corner) for corner in corners) for face in model.f[::97].tolist())
    (material,) = surface.object.data.materials
    (image,) = [node.image for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
    assert image.packed_files
    assert image.size[:] == (32, 32)
    assert [layer.name for layer in surface.object.data.uv_layers]


def test_materials_have_the_same_coordinates_as_on_the_source(coarse, tmp_path):
    """Generated coordinates of the rest mesh, rendered for both posed meshes."""
    hand = coarse.make_rigged_hand()
    (material,) = hand.mesh.data.materials
    nodes, links = material.node_tree.nodes, material.node_tree.links
    emission = nodes.new("ShaderNodeEmission")
    links.new(nodes.new("ShaderNodeTexCoord").outputs["Generated"], emission.inputs["Color"])
    links.new(emission.outputs[0], nodes["Material Output"].inputs["Surface"])
    hand_model_from_mesh(bpy.context, hand.mesh, hand.armature, hand.joint_map, tmp_path / "mine.npz")
    hand.pose_like(np.random.default_rng(0).normal(size=(16, 3)) * 0.3)
    bpy.context.view_layer.update()
    posed = evaluated_world_vertices(hand.mesh)
    theirs = _emitted(hand.mesh, tmp_path / "theirs.png", posed)
    coarse.remove(hand)

    model = load_hand_model(tmp_path / "mine.npz")
    surface = OwnSurface.of_materials(model, tmp_path / "mine.blend")
    surface.object.data.shape_keys.key_blocks["Posed"].data.foreach_set("co", posed.astype(np.float32).ravel())
    surface.object.data.update_tag()
    ours = _emitted(surface.object, tmp_path / "ours.png", posed)
    assert (theirs[..., 3] > 200).sum() > 60
    np.testing.assert_allclose(ours, theirs, atol=3)


def _emitted(thing, path, posed):
    """[H, W, 4] of an image with emission only."""
    scene = bpy.context.scene
    if scene.camera is None:
        scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        scene.collection.objects.link(scene.camera)
        scene.camera.data.type = "ORTHO"
        scene.camera.data.ortho_scale = 0.22
        scene.camera.location = posed.mean(0) + np.array([0, 0, 1])
    scene.render.engine = "CYCLES"
    scene.cycles.samples, scene.cycles.use_denoising = 4, False
    scene.render.film_transparent = True
    scene.view_settings.view_transform = "Raw"
    scene.render.dither_intensity = 0
    scene.render.resolution_x, scene.render.resolution_y = 32, 32
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    with Image.open(path) as image:
        return np.asarray(image, int)


def test_a_look_of_another_hand_is_rejected(files, tmp_path):
    model = load_hand_model(files / "mine.npz")
    with pytest.raises(LiveHandError, match="no look at"):
        OwnSurface.of_materials(model, files / "none.blend")
    with pytest.raises(LiveHandError, match="got that of another hand"):
        OwnSurface.of_materials(model, files / "mine_left.blend")
    with pytest.raises(LiveHandError, match=f"one mesh of the {len(load_default_hand().v_template)} vertices"):
        OwnSurface.of_materials(load_default_hand(), files / "mine.blend")
    (tmp_path / "no.blend").write_text("no Blender file")
    with pytest.raises(LiveHandError, match=r"must be a \.blend"):
        OwnSurface.of_materials(model, tmp_path / "no.blend")


def test_a_hand_without_a_look_gets_a_plain_skin(files):
    model = load_hand_model(files / "mine_left.npz")
    capture_scene()
    surface = OwnSurface.plain(model, SkinTone())
    pose = HandPose(np.full((16, 3), 0.1), np.zeros(10), np.zeros(3), "left")
    surface.set_pose(pose)
    bpy.context.view_layer.update()
    np.testing.assert_allclose(evaluated_world_vertices(surface.object), posed_vertices(model, pose), atol=1e-6)


def test_a_left_hands_poses_are_the_mirror_image_of_a_rights():
    plan = CapturePlan(poses=4, cameras=5)
    right = load_default_hand()
    left = right.for_side("left")
    of_right, of_left = (plan.make(Path(), model, {}) for model in (right, left))
    for one, other in zip(of_right.poses, of_left.poses, strict=True):
        assert other.side == "left"
        mirrored = posed_vertices(right, one) * [-1, 1, 1]
        np.testing.assert_allclose(posed_vertices(left, other), mirrored, atol=1e-9)
    for one, other in zip(of_right.views, of_left.views, strict=True):
        np.testing.assert_array_equal(one.camera.cam2world, other.camera.cam2world)


def test_gestures_are_relative_to_the_rest_pose(files):
    """This hand's rest pose is spread and straight, but the same gesture must give the same finger directions."""
    plan = CapturePlan(poses=12, cameras=5)
    models = load_default_hand(), load_hand_model(files / "mine.npz")
    ours, theirs = (directions_of(model, plan.make(Path(), model, {}).poses) for model in models)
    assert np.rad2deg(np.arccos((ours * theirs).sum(-1))).mean() < 8
    spread = [model.joints[2] - model.joints[1] for model in models]  # at rest the index fingers differ by more
    assert np.rad2deg(np.arccos(np.dot(*spread) / np.prod(np.linalg.norm(spread, axis=1)))) > 12


def directions_of(model, poses):
    """[P, 8, 3] of the first two bones of each finger, in the turned palm's frame."""
    found = []
    for pose in poses:
        turns = list(axis_angle_to_matrix(np.r_[np.zeros((1, 3)), pose.theta[1:]]))
        for joint in range(1, 16):
            turns[joint] = turns[PARENTS[joint]] @ turns[joint]
        bones = [(first + k, first + k + 1) for first in (1, 4, 7, 10) for k in range(2)]
        along = np.array([turns[a] @ (model.joints[b] - model.joints[a]) for a, b in bones])
        found.append(along / np.linalg.norm(along, axis=1, keepdims=True))
    return np.array(found)


@pytest.mark.nightly
def test_the_trained_avatar_renders_in_blender(trained, files):
    folder, avatar_path = trained
    model = load_hand_model(files / "mine.npz")
    assert load_avatar(avatar_path).hand_sha256 == model.sha256 == load_capture(folder).hand_sha256
    capture = load_capture(folder)
    assert capture.provenance["look_sha256"] == hashlib.sha256((files / "mine.blend").read_bytes()).hexdigest()
    view = capture.of_split("novel_pose")[0]
    truth = torch.as_tensor(capture.read_image(view)[..., 3])

    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    armature = add_hand(bpy.context, model, str(files / "mine.npz"))
    assert [key.name for key in armature.livehand.mesh.data.shape_keys.key_blocks] == ["Basis"]
    armature.livehand.avatar_path = str(avatar_path)
    pose = capture.poses[view.pose_index]
    write_theta(RiggedHand.of(armature), pose.theta)
    write_transl(RiggedHand.of(armature), pose.transl)
    scene.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    scene.collection.objects.link(scene.camera)
    use_livehand(scene)
    set_camera(scene, view.camera)
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    scene.render.filepath = str(files / "frame.png")
    bpy.ops.render.render(write_still=True)
    with Image.open(files / "frame.png") as image:
        alpha = torch.as_tensor(np.asarray(image)[..., 3] / 255.0)
    assert alpha_iou(alpha.float(), truth) > 0.9
    bpy.ops.wm.save_as_mainfile(filepath=str(files / "shot.blend"))
    out = files / "frames"
    assert main(["render", str(files / "shot.blend"), "-o", str(out), "--format", "png", "--frames", "1"]) == 0
    (written,) = out.rglob("*.png")
    with Image.open(written) as image:
        np.testing.assert_allclose(np.asarray(image)[..., 3] / 255.0, alpha, atol=0.02)


def test_a_pose_file_renders_with_the_new_hand(trained, files, capsys):
    take, out = files / "take.npz", files / "pictures"
    write_motion(HandMotion(np.zeros((1, 16, 3)), np.zeros(10), np.zeros((1, 3))), take)
    asked = ["render", str(take), "--avatar", str(trained[1]), "-o", str(out), "--size", "48x64", "--device", "cpu"]
    assert main(asked) == 1
    assert "must be given its own hand model 'mine'" in capsys.readouterr().err
    assert main([*asked, "--hand", str(files / "mine.npz")]) == 0
    with Image.open(out / "0001.png") as image:
        assert 0.05 < (np.asarray(image)[..., 3] > 128).mean() < 0.9


def test_shape_operators_report_a_hand_without_shapes(files):
    add_hand(bpy.context, load_hand_model(files / "mine.npz"), str(files / "mine.npz"))
    for run in (bpy.ops.livehand.random_shape, bpy.ops.livehand.match_measurements):
        with pytest.raises(RuntimeError, match="'mine' has none"):
            run()


def test_the_operator_writes_both_files_and_keeps_the_scene(coarse, files, tmp_path):
    hand = coarse.make_rigged_hand()
    bpy.context.view_layer.objects.active = hand.mesh
    hand.pose_like(np.full((16, 3), 0.2))  # the rest pose counts, not this one
    hand.mesh.modifiers.new("Subdivision", "SUBSURF").render_levels = 1
    Image.fromarray(np.full((8, 8, 3), 200, np.uint8)).save(tmp_path / "paint.png")
    image = bpy.data.images.load(str(tmp_path / "paint.png"))
    (texture,) = [node for node in hand.mesh.data.materials[0].node_tree.nodes if node.type == "TEX_IMAGE"]
    texture.image = image
    kinds = ("scenes", "objects", "meshes", "materials", "images", "armatures")
    before = {kind: sorted(thing.name for thing in getattr(bpy.data, kind)) for kind in kinds}
    path = tmp_path / "posed.npz"
    with pytest.raises(RuntimeError, match=r"call it posed_left\.npz"):
        bpy.ops.livehand.make_hand_model(filepath=str(path), bones=str(_left_map(hand, tmp_path)))
    assert list(tmp_path.glob("*.npz")) == []
    assert bpy.ops.livehand.make_hand_model(filepath=str(path)) == {"FINISHED"}
    assert {kind: sorted(thing.name for thing in getattr(bpy.data, kind)) for kind in kinds} == before
    assert not image.packed_files
    assert bpy.path.abspath(image.filepath) == str(tmp_path / "paint.png")
    assert hand.armature.data.pose_position == "POSE"
    assert hand.mesh.modifiers["Subdivision"].show_viewport
    model = load_hand_model(path)
    extents = np.ptp(model.v_template, axis=0)
    np.testing.assert_allclose(extents, np.ptp(load_hand_model(files / "mine.npz").v_template, axis=0), atol=1e-5)

    capture_scene()
    surface = OwnSurface.of_materials(model, path.with_suffix(".blend"))
    assert surface.object.modifiers["Subdivision"].render_levels == 1
    assert len(surface.object.data.vertices) == len(model.v_template)
    (tmp_path / "paint.png").unlink()
    nodes = surface.object.data.materials[0].node_tree.nodes
    assert [node.image.pixels[0] for node in nodes if node.type == "TEX_IMAGE"] == [pytest.approx(200 / 255, abs=1e-3)]

    bpy.ops.wm.open_mainfile(filepath=str(path.with_suffix(".blend")))
    assert [thing.type for thing in bpy.context.scene.objects] == ["MESH"]


def test_a_characters_hand_is_cut_out_with_its_look(coarse, tmp_path):
    """Arm, body and hand in one subdivided mesh, which is split along a seam as file formats split it."""
    hand = coarse.make_rigged_hand()
    alone = hand_model_from_mesh(bpy.context, hand.mesh, hand.armature, hand.joint_map, tmp_path / "alone.npz")
    grow_into_a_character(hand, coarse.FOREARM)
    modifier = hand.mesh.modifiers.new("Subdivision", "SUBSURF")
    modifier.levels = modifier.render_levels = 1
    count = len(hand.mesh.data.vertices)
    made = hand_model_from_mesh(bpy.context, hand.mesh, hand.armature, hand.joint_map, tmp_path / "cut.npz")
    model, other = (load_hand_model(tmp_path / name) for name in ("cut.npz", "alone.npz"))
    assert made["vertices"] < count - 100
    assert abs(made["vertices"] - alone["vertices"]) < 150
    assert 0.02 < made["subdivision_moves_mm"] < 3
    assert alone["subdivision_moves_mm"] == 0
    np.testing.assert_allclose(model.joints, other.joints, atol=1e-6)
    fingers = model.v_template[:, 0] < 0.05
    assert fingers.sum() == (other.v_template[:, 0] < 0.05).sum()
    stump = model.v_template[:, 0].max() - model.joints[0, 0]
    assert 0.01 < stump < 0.05

    capture_scene()
    surface = OwnSurface.of_materials(model, tmp_path / "cut.blend")
    surface.object.modifiers.clear()
    surface.set_pose(HandPose(np.zeros((16, 3)), np.zeros(10), np.zeros(3), "right"))
    bpy.context.view_layer.update()
    np.testing.assert_allclose(evaluated_world_vertices(surface.object), model.v_template, atol=1e-6)
    mesh = surface.object.data
    edges = [key for polygon in mesh.polygons for key in polygon.edge_keys]
    assert {edges.count(key) for key in edges[::37]} == {2}  # closed, cap and seam included
    creases = mesh.attributes["crease_edge"].data
    assert 4 < sum(crease.value == 1 for crease in creases) < 100


def test_missing_pictures_are_replaced_by_the_materials_colour(coarse, tmp_path):
    hand = coarse.make_rigged_hand()
    (material,) = hand.mesh.data.materials
    (texture,) = [node for node in material.node_tree.nodes if node.type == "TEX_IMAGE"]
    texture.image = image = _picture_elsewhere("Z:\\artist\\skin\\paint.png")
    material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = (0.1, 0.2, 0.3, 1)
    path = tmp_path / "mine.npz"
    made = hand_model_from_mesh(bpy.context, hand.mesh, hand.armature, hand.joint_map, path)
    assert made["pictures_missing"] == [image.filepath]
    assert texture.image == image
    assert sorted(file.name for file in tmp_path.iterdir()) == ["mine.blend", "mine.npz"]
    capture_scene()
    surface = OwnSurface.of_materials(load_hand_model(path), path.with_suffix(".blend"))
    nodes = surface.object.data.materials[0].node_tree.nodes
    (stand_in,) = [node.image for node in nodes if node.type == "TEX_IMAGE"]
    np.testing.assert_allclose(stand_in.pixels[:], [0.1, 0.2, 0.3, 1], atol=1e-6)


def test_missing_pictures_are_found_beside_the_file_whatever_their_path(tmp_path):
    (tmp_path / "textures").mkdir()
    Image.fromarray(np.full((2, 2, 3), 9, np.uint8)).save(tmp_path / "textures" / "Paint.PNG")
    lost, gone = (_picture_elsewhere(f"C:\\Users\\artist\\{name}") for name in ("paint.png", "other.png"))
    find_pictures(tmp_path)
    assert Path(lost.filepath) == tmp_path / "textures" / "Paint.PNG"
    assert not is_missing(lost)
    assert is_missing(gone)


def _picture_elsewhere(path):
    image = bpy.data.images.new("Paint", 2, 2)
    image.source, image.filepath = "FILE", path
    return image


def test_a_hand_in_several_meshes_is_refused_with_the_remedy(coarse, tmp_path):
    """The fingers beyond the knuckles are an object of their own, as gloves and nails are."""
    hand = coarse.make_rigged_hand()
    fingers = hand.mesh.copy()
    fingers.data = hand.mesh.data.copy()
    bpy.context.collection.objects.link(fingers)
    last = {hand.mesh.vertex_groups[name].index for name in coarse.JOINTS if name.endswith("distal")}
    for mesh, keeps_ends in ((hand.mesh, False), (fingers, True)):
        cut = bmesh.new()
        cut.from_mesh(mesh.data)
        weights = cut.verts.layers.deform.active
        is_end = {vertex: any(group in last for group in vertex[weights].keys()) for vertex in cut.verts}
        gone = [vertex for vertex, end in is_end.items() if end != keeps_ends]
        bmesh.ops.delete(cut, geom=gone, context="VERTS")
        cut.to_mesh(mesh.data)
        cut.free()
    mesh = mesh_skinned_to(hand.armature, hand.joint_map)
    with pytest.raises(LiveHandError, match=r"index1.*if the hand is in several meshes, join them \(Object > Join\)"):
        hand_model_from_mesh(bpy.context, mesh, hand.armature, hand.joint_map, tmp_path / "part.npz")
    assert list(tmp_path.iterdir()) == []


def test_another_hands_files_are_not_replaced(coarse, tmp_path):
    hand = coarse.make_rigged_hand()
    asked = bpy.context, hand.mesh, hand.armature, hand.joint_map
    look, path = tmp_path / "mine.blend", tmp_path / "mine.npz"
    look.write_text("a user's")
    with pytest.raises(LiveHandError, match=r"mine\.blend beside the hand model must be free"):
        hand_model_from_mesh(*asked, path, overwrites=True)
    assert (look.read_text(), path.exists()) == ("a user's", False)
    path.write_text("another hand")
    with pytest.raises(LiveHandError, match=r"mine\.npz exists already.*--overwrite"):
        hand_model_from_mesh(*asked, path)
    with pytest.raises(LiveHandError, match=r"0\.1 to 0\.3 m"):
        hand_model_from_mesh(*asked, path, scale=50.0, overwrites=True)
    assert (look.read_text(), path.read_text()) == ("a user's", "another hand")
    look.unlink()
    made = hand_model_from_mesh(*asked, path, overwrites=True, has_materials=False)
    assert made["look"] is None
    assert [file.name for file in tmp_path.iterdir()] == ["mine.npz"]
    assert load_hand_model(path).side == "right"


def grow_into_a_character(hand, forearm):
    """Extend the mesh along the forearm, add a body beside it, and split some faces off at their edges."""
    mesh = hand.mesh.data
    bones = hand.armature.data.bones
    out = np.array(bones[forearm].head_local - bones["wrist"].head_local)
    out /= np.linalg.norm(out)
    group = hand.mesh.vertex_groups[forearm].index
    grown = bmesh.new()
    grown.from_mesh(mesh)
    deform = grown.verts.layers.deform.active
    for _ in range(8):
        end = max(np.array(face.calc_center_median()) @ out for face in grown.faces)
        ending = [
            face
            for face in grown.faces
            if np.array(face.normal) @ out > 0.5 and np.array(face.calc_center_median()) @ out > end - 1.0
        ]
        made = bmesh.ops.extrude_face_region(grown, geom=ending)
        fresh = [thing for thing in made["geom"] if isinstance(thing, bmesh.types.BMVert)]
        bmesh.ops.delete(grown, geom=ending, context="FACES")
        bmesh.ops.translate(grown, verts=fresh, vec=(1.2 * out).tolist())
        for vertex in fresh:
            vertex[deform].clear()
            vertex[deform][group] = 1.0
    body = bmesh.ops.create_icosphere(grown, subdivisions=3, radius=12, matrix=Matrix.Translation((30 * out).tolist()))
    for vertex in body["verts"]:
        vertex[deform][group] = 1.0
    middle = float(np.median([vertex.co.y for vertex in grown.verts]))
    seam = [edge for edge in grown.edges if edge.verts[0].co.y < middle <= edge.verts[1].co.y and edge.index % 3]
    bmesh.ops.split_edges(grown, edges=seam)
    grown.to_mesh(mesh)
    grown.free()
    mesh.update()


def _left_map(hand, folder):
    from livehand.backend.hand.model import JOINT_NAMES

    path = folder / "bones.json"
    bones = dict(zip(JOINT_NAMES, hand.joint_map.bones, strict=True))
    path.write_text(json.dumps({"side": "left", **bones}))
    return path


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["none.glb"], "no character at"),
        (["mine.npz"], "must be a .blend, .glb, .gltf, .vrm or .fbx"),
        (["right.glb", "--armature", "Nobody"], "the armature 'Nobody'"),
        (["right.glb", "--mesh", "Nothing"], "mesh of 'Elsewhere' 'Nothing'"),
        (["right.glb", "--scale", "100"], "0.1 to 0.3 m"),
        (["right.glb", "--side", "left"], "must have 'left' in its name"),
        (["right.glb", "--bones", "mine.npz"], "must be JSON"),
    ],
)
def test_make_hand_reports_errors(files, arguments, said, tmp_path, capsys):
    character, *others = arguments
    others = [str(files / value) if value == "mine.npz" else value for value in others]
    assert main(["make-hand", str(files / character), "-o", str(tmp_path / "x.npz"), *others]) == 1
    assert said in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
