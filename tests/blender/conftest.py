"""Blender as a module, with LiveHand registered once; every test starts from an empty file."""

import hashlib
import runpy
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import bpy
import livehand
import numpy as np
import pytest
import torch
from livehand.backend.hand.corrective_keys import factor_correctives
from livehand.backend.hand.lbs import SkinTensors, pose_hand
from livehand.backend.hand.model_file import ARM_KEY, load_default_hand, load_hand_model
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.shot import HandPose
from livehand.backend.system.package_files import fetch_files
from livehand.backend.tracking.weights import PACKAGE, has_networks, keep_networks
from livehand.livehand_blender.rig import hand_mesh
from livehand.livehand_blender.rig.build import add_hand
from livehand.tools.builtin_hand import TEMPLATE


@pytest.fixture(scope="session", autouse=True)
def registered():
    # What is still registered when the process ends hangs Blender 4.5.
    livehand.register()
    yield
    livehand.unregister()


@pytest.fixture(scope="session", autouse=True)
def _ctrl_c_is_handled():
    """A shell starts background processes, and thereby their children, with Ctrl-C ignored."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture(scope="session", autouse=True)
def _correctives_are_factored_once():
    """A model's, which nearly every test builds a hand of: of the 65 ms that takes, 27 are their decomposition."""
    factored = {}

    def once(posedirs):
        key = hashlib.sha256(posedirs.tobytes()).digest()
        if key not in factored:
            factored[key] = factor_correctives(posedirs)
        return factored[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(hand_mesh, "factor_correctives", once)
        yield


@pytest.fixture(autouse=True)
def _empty_file(registered):
    # read_factory_settings would disable add-ons.
    bpy.ops.wm.read_homefile(use_empty=True)


@pytest.fixture(scope="session", params=["right", "left"])
def model(request):
    return load_default_hand().for_side(request.param)


@pytest.fixture(scope="session")
def armed_path(tmp_path_factory):
    """A file of the built-in hand whose stump turns as a forearm, with a wrist joint that moves with beta."""
    plain = load_hand_model(TEMPLATE)
    share = np.clip((plain.v_template[:, 0] - plain.joints[0, 0]) / 0.02 + 0.5, 0, 1)
    shapes = np.random.default_rng(0).normal(size=plain.shapedirs.shape) * 1e-3
    with np.load(TEMPLATE) as file:
        arrays = dict(file) | {"shapedirs": plain.shapedirs + shapes}
    arrays[ARM_KEY] = plain.lbs_weights[:, 0] * share**2 * (3 - 2 * share)
    path = tmp_path_factory.mktemp("armed") / "armed.npz"
    np.savez(path, **arrays)
    return path


@pytest.fixture(scope="session")
def armed_model(model, armed_path):
    return load_hand_model(armed_path).for_side(model.side)


@pytest.fixture
def armed_hand(armed_model, armed_path):
    return add_hand(bpy.context, armed_model, str(armed_path))


@pytest.fixture
def hand(model):
    return add_hand(bpy.context, model)


@pytest.fixture(scope="session")
def evaluated_vertices():
    """A function: the hand's evaluated mesh [V, 3] in the mesh object's own space."""

    def of(armature):
        depsgraph = bpy.context.evaluated_depsgraph_get()
        mesh = armature.livehand.mesh.evaluated_get(depsgraph).to_mesh()
        flat = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", flat)
        return flat.reshape(-1, 3).astype(np.float64)

    return of


@pytest.fixture(scope="session")
def backend_vertices():
    """A function: the backend's vertices for a pose, in float64."""

    def of(model, pose):
        skin = SkinTensors.of(model, dtype=torch.float64)
        tensors = (
            torch.tensor(np.asarray(value), dtype=torch.float64)
            for value in (pose.theta, pose.beta, pose.transl, pose.forearm)
        )
        return pose_hand(skin, *tensors).vertices.numpy()

    return of


@pytest.fixture(scope="session")
def random_pose():
    """A function: a pose far beyond a real hand's, so that errors are not hidden by small values."""

    def of(seed, side):
        rng = np.random.default_rng(seed)
        return HandPose(rng.normal(size=(16, 3)) * 0.8, rng.normal(size=10) * 1.5, rng.normal(size=3) * 0.2, side)

    return of


@pytest.fixture(scope="session")
def fake_renderer():
    """A renderer class that needs no avatar."""
    return runpy.run_path(str(Path(__file__).parent / "fake_livehand.py"))["FakeRenderer"]


@pytest.fixture
def fake_session(registered, fake_renderer, monkeypatch):
    """The engine's session, with the fake renderer; its `made` lists the renderers it has asked for."""
    from livehand.backend.render.session import Session
    from livehand.livehand_blender.render.engine import LiveHandRender

    made = []

    def make(avatar_path, hand, device):
        made.append(fake_renderer(avatar_path, hand, device))
        return made[-1]

    session = Session(make)
    session.made = made
    monkeypatch.setattr(LiveHandRender, "hands_session", session)
    return session


@pytest.fixture
def hand_scene():
    """A scene of 48 x 64 px with the built-in hand and a camera that sees all of it but its arm's end."""
    from livehand.livehand_blender.scene.settings import use_livehand

    scene = bpy.context.scene
    add_hand(bpy.context, load_default_hand())
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.location = (-0.08, 0, 0.5)
    scene.collection.objects.link(camera)
    scene.camera = camera
    use_livehand(scene)
    scene.render.resolution_x, scene.render.resolution_y = 48, 64
    scene.view_layers[0].use_pass_z = True
    bpy.context.view_layer.update()
    return scene


@pytest.fixture(scope="session")
def tracker_networks():
    """The tracker's networks are in the data folder, or the test is skipped."""
    if not has_networks():
        try:
            keep_networks(fetch_files(PACKAGE))
        except LiveHandError as error:
            pytest.skip(f"the tracker's networks cannot be fetched: {error}")


@pytest.fixture
def shot_path(hand_scene, tmp_path):
    """A saved shot of three frames."""
    hand_scene.frame_start, hand_scene.frame_end = 1, 3
    path = tmp_path / "wave.blend"
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    return path


@pytest.fixture(scope="session")
def read_exr():
    """path -> {channel: [H, W]} of a zip-compressed EXR, by the file format's own description."""
    return runpy.run_path(str(Path(__file__).parent / "exr.py"))["read_exr"]


@pytest.fixture(scope="session")
def use_multilayer_exr():
    """A function: make a scene save every pass; Blender 5 offers that only among files of their own kind."""

    def use(scene, depth="32"):
        settings = scene.render.image_settings
        if hasattr(settings, "media_type"):
            settings.media_type = "MULTI_LAYER_IMAGE"
        settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", depth, "ZIP"

    return use


@pytest.fixture(scope="session")
def curves_of():
    """A function: all curves of an action with one slot, in Blender 4 and 5."""

    def of(action):
        if hasattr(action, "fcurves"):  # until Blender 5.0
            return action.fcurves
        bags = [bag for layer in action.layers for strip in layer.strips for bag in strip.channelbags]
        return [curve for bag in bags for curve in bag.fcurves]

    return of


@pytest.fixture(scope="session")
def other_rigs(registered):
    """The module other_rigs.py, which makes a rigged hand that differs from ours."""
    return SimpleNamespace(**runpy.run_path(str(Path(__file__).parent / "other_rigs.py")))


# The human metarig's arms and hands, and the rig generated from them; the face would take a minute. In a process of its
# own, because Rigify cannot be enabled twice, and one in which it stays enabled hangs at exit.
RIGIFY = """
import os, sys, bpy
import addon_utils
bpy.ops.wm.read_homefile(use_empty=True)
addon_utils.enable("rigify", default_set=True)  # its parameters need the preferences
bpy.ops.object.armature_human_metarig_add()
armature = bpy.context.active_object
bpy.ops.object.mode_set(mode="EDIT")
kept = ("spine", "shoulder", "upper_arm", "forearm", "hand", "palm", "f_", "thumb")
for bone in list(armature.data.edit_bones):
    if not bone.name.startswith(kept):
        armature.data.edit_bones.remove(bone)
bpy.ops.object.mode_set(mode="OBJECT")
armature.name = "metarig"
bpy.ops.pose.rigify_generate()
bpy.context.active_object.name = "generated"
bpy.ops.wm.save_as_mainfile(filepath=sys.argv[1])
sys.stdout.flush()
os._exit(0)
"""


@pytest.fixture(scope="session")
def rigify_file(tmp_path_factory):
    """Path of a file with Rigify's `metarig` of arms and hands, and the rig `generated` from it."""
    path = tmp_path_factory.mktemp("rigify") / "rigify.blend"
    subprocess.run([sys.executable, "-c", RIGIFY, str(path)], check=True, capture_output=True, timeout=240)
    return path
