"""An avatar's hand as a textured, skinned glTF: what the file holds, and that it is our surface when it is posed."""

import json
import struct
from dataclasses import replace

import bpy
import numpy as np
import pytest
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.geometry.local_rotation import LocalFrames
from livehand.backend.geometry.mesh import posed_mesh
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.topology import topology_of
from livehand.backend.motion.motion import HandMotion
from livehand.backend.motion.writers.take import Take, TakenHand
from livehand.backend.motion.writers.writer import WriteOptions
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.avatar_surface import avatar_surface_of
from livehand.backend.surface.detail_mesh import DetailTemplate
from livehand.livehand_blender.rigs.blender_writers import BLENDER_WRITERS
from scipy.spatial import KDTree

GLTF = next(writer for writer in BLENDER_WRITERS if writer.name == "gltf")
OF_LIGHT = WriteOptions(avatars={"right": shipped_avatar_path("light")}, texture_px=64)
MOST_M = 0.0003


@pytest.fixture(scope="module")
def take():
    axes = FingerAxes.of_default_hand()
    theta = np.array([theta_of(GESTURES[name].angles_deg(), axes) for name in ("rest", "relaxed", "fist")])
    motion = HandMotion(theta, np.zeros(10), np.zeros((3, 3)), 24.0, "right")
    return Take((TakenHand(motion, load_default_hand()),), 24.0)


@pytest.fixture(scope="module")
def glb(take, registered, tmp_path_factory):
    path = tmp_path_factory.mktemp("glb") / "hand.glb"
    GLTF.write(take, path, OF_LIGHT)
    return path


def content_of(path):
    raw = path.read_bytes()
    (length,) = struct.unpack("<I", raw[12:16])
    return json.loads(raw[20 : 20 + length])


def test_the_file_has_a_atlas_textures_and_correctives(glb):
    content = content_of(glb)
    (mesh,) = content["meshes"]
    (primitive,) = mesh["primitives"]
    assert {"POSITION", "NORMAL", "TEXCOORD_0", "JOINTS_0", "WEIGHTS_0"} <= primitive["attributes"].keys()
    assert len(primitive["targets"]) == 57  # 14 of the model, veins, 42 forms
    assert len(content["skins"][0]["joints"]) == 17
    (material,) = content["materials"]
    surface = material["pbrMetallicRoughness"]
    assert {"baseColorTexture", "metallicRoughnessTexture"} <= surface.keys()
    assert "normalTexture" in material
    assert len(content["images"]) == 3
    paths = {channel["target"]["path"] for channel in content["animations"][0]["channels"]}
    assert {"rotation", "weights"} <= paths


def test_the_posed_mesh_is_our_surface(glb, take):
    """Imported again: every vertex lies on the surface that the renderer shows, with what bending raises."""
    bpy.context.scene.render.fps = 24
    bpy.ops.import_scene.gltf(filepath=str(glb))
    mesh = next(thing for thing in bpy.context.scene.objects if thing.type == "MESH" and "Hand" in thing.name)
    hand, motion = take.hands[0].own_model, take.hands[0].motion
    avatar = load_avatar(shipped_avatar_path("light"))
    skin = avatar_surface_of(avatar, torch.device("cpu"))
    template, topology = DetailTemplate.of(skin.surface, hand), topology_of(hand)
    frames = LocalFrames.of(hand.v_template, hand.f, "cpu")
    for index in range(3):
        bpy.context.scene.frame_set(index)
        evaluated = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
        theirs = np.array([evaluated.matrix_world @ vertex.co for vertex in evaluated.data.vertices])
        pose = motion.pose(index)
        vertices = torch.as_tensor(posed_vertices(hand, pose), dtype=torch.float32)
        posed = posed_mesh(topology, vertices)
        ours = skin.posed(template, pose, posed, frames, ReferenceBackend()).vertices.numpy()
        distance, _ = KDTree(ours).query(theirs)
        assert np.percentile(distance, 99) < MOST_M
        assert distance.max() < 2 * MOST_M


def test_an_avatar_of_another_hand_is_refused(take, tmp_path):
    other = replace(take.hands[0].model, sha256="0" * 64)
    wrong = Take((replace(take.hands[0], model=other),), 24.0)
    with pytest.raises(LiveHandError, match="must be worn by its own hand model"):
        GLTF.write(
            wrong, tmp_path / "a.glb", WriteOptions(avatars={"right": shipped_avatar_path("light")}, texture_px=64)
        )
    assert not (tmp_path / "a.glb").exists()
