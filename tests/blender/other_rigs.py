"""Makes a rigged hand for tests that differs from ours in bones, rolls, mesh, size and place.

25 joints named as in WebXR below a forearm, in centimetres, on an object of scale 0.01 in a Z-up world. Its rest
pose is spread and straight. The ground truth is known by construction: it is our hand in a pose and a shape, stretched.
So `pose_like(theta)` rotates its bones as theta rotates ours, and its bones' heads are its joints.
"""

from __future__ import annotations

import subprocess
import sys
import warnings
from dataclasses import dataclass
from pathlib import Path

import bpy
import numpy as np
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_quaternion
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import SkinTensors, pose_hand
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT, PARENTS
from livehand.backend.hand.model_file import load_hand_model
from livehand.backend.rigs.source_skeleton import JointMap
from livehand.tools.builtin_hand import TEMPLATE
from mathutils import Vector
from mathutils.bvhtree import BVHTree

MANO_FINGERS = ("index", "middle", "pinky", "ring", "thumb")
_LONG = ("phalanx-proximal", "phalanx-intermediate", "phalanx-distal")
_SHORT = ("metacarpal", "phalanx-proximal", "phalanx-distal")
# In MANO's order of joints, and of fingers.
JOINTS = (
    "wrist",
    *(f"{finger}-finger-{part}" for finger in MANO_FINGERS[:4] for part in _LONG),
    *(f"thumb-{part}" for part in _SHORT),
)
TIPS = (*(f"{finger}-finger-tip" for finger in MANO_FINGERS[:4]), "thumb-tip")
METACARPALS = tuple(f"{finger}-finger-metacarpal" for finger in MANO_FINGERS[:4])
FOREARM = "forearm"

_CM = 100.0  # data's units in a metre
_STRETCH = np.array([1.06, 1.0, 0.96])  # of our template: longer and narrower
_VOXEL_M = 0.0032
_FOREARM_M = 0.22
_TIP_BONE_M = 0.008
# Template -> the armature's own axes: fingers along +Y, back of the hand up, unlike in our rig.
_TURN = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


@dataclass
class OtherHand:
    """The rig and its ground truth.

    Attributes:
        armature: the armature object.
        mesh: the mesh object.
        side: which hand.
        rest_turns: [16, 3, 3] of our joints, in the template's frame, from our rest pose into this one's.
    """

    armature: bpy.types.Object
    mesh: bpy.types.Object
    side: str
    rest_turns: np.ndarray

    @property
    def joint_map(self) -> JointMap:
        """The true joint map."""
        return JointMap(self.side, JOINTS, TIPS, FOREARM)

    def pose_like(self, theta: np.ndarray, cupped_deg: float = 0.0) -> None:
        """Rotate the bones as theta [16, 3] (of this side) rotates ours; cup the little finger's metacarpal.

        The wrist rotates relative to the forearm, which does not move.
        """
        turns = _global_turns(theta) @ self.rest_turns.swapaxes(1, 2)  # from this rig's rest pose
        turns = _TURN @ turns @ _TURN.T
        for joint, name in enumerate(JOINTS):
            above = turns[PARENTS[joint]] if joint else np.eye(3)
            self._turn(name, above.T @ turns[joint])
        self._turn(METACARPALS[2], axis_angle_to_matrix(np.deg2rad([-cupped_deg, 0, 0])))

    def key(self, frame: int) -> None:
        """Key the present pose."""
        for name in (FOREARM, *JOINTS, METACARPALS[2]):
            bone = self.armature.pose.bones[name]
            bone.keyframe_insert("rotation_quaternion", frame=frame)
            bone.keyframe_insert("location", frame=frame)

    def animate(self, names: tuple[str, ...] = ("rest", "fist", "point", "pinch", "relaxed"), step: int = 5) -> range:
        """Key one gesture every few frames while wrist and forearm rotate; returns all frames."""
        axes = FingerAxes.of_default_hand()
        for number, name in enumerate(names):
            root = np.array([0.3, -0.5, 0.4]) * np.sin(number)
            theta = theta_of(GESTURES[name].angles_deg(), axes, root)
            self.pose_like(theta if self.side == "right" else theta * MIRROR_AXIS_ANGLE)
            forearm = self.armature.pose.bones[FOREARM]
            forearm.rotation_quaternion = matrix_to_quaternion(
                axis_angle_to_matrix(np.array([0.2, 0.3, -0.2]) * number)
            )
            forearm.location = (1.0 * number, 0.5 * number, 0)
            self.key(1 + number * step)
        scene = bpy.context.scene
        scene.frame_start, scene.frame_end = 1, 1 + (len(names) - 1) * step
        return range(scene.frame_start, scene.frame_end + 1)

    def joints(self) -> np.ndarray:
        """[16, 3] m: the joints in the world in the current frame, in MANO's order."""
        return bone_heads(self.armature, JOINTS)

    def fingertips(self) -> np.ndarray:
        """[5, 3] m: the fingertips in the world in the current frame, in MANO's order of fingers."""
        return bone_heads(self.armature, TIPS)

    def _turn(self, name: str, turn: np.ndarray) -> None:
        """Rotate a bone relative to its parent by [3, 3] in the armature's axes at rest."""
        bone = self.armature.pose.bones[name]
        frame = np.array(bone.bone.matrix_local.to_3x3(), np.float64)
        bone.rotation_quaternion = matrix_to_quaternion(frame.T @ turn @ frame)


def bone_heads(armature: bpy.types.Object, names: tuple[str, ...]) -> np.ndarray:
    """[N, 3] m: heads of bones in the world in the current frame."""
    bpy.context.view_layer.update()
    evaluated = armature.evaluated_get(bpy.context.evaluated_depsgraph_get())
    return np.array([evaluated.matrix_world @ evaluated.pose.bones[name].head for name in names])


def make_rigged_hand(side: str = "right", seed: int = 4, name: str = "Elsewhere") -> OtherHand:
    """Build the rig in the scene's collection, at rest.

    Args:
        side: which hand.
        seed: of the shape, the rolls and the place.
        name: of its objects.
    """
    rng = np.random.default_rng(seed)
    right = load_hand_model(TEMPLATE)
    theta = theta_of(GESTURES["spread"].angles_deg(), FingerAxes.of_default_hand())
    beta = rng.normal(size=10) * 0.8
    posed = pose_hand(SkinTensors.of(right), *_tensors(theta, beta, np.zeros(3)))
    vertices, joints = posed.vertices.numpy().astype(float), posed.joints.numpy().astype(float)
    tips = vertices[_tip_vertices(right)]
    mirror = np.ones(3) if side == "right" else MIRROR_POINT
    to_data = _CM * (_STRETCH * mirror)[:, None] * _TURN.T  # rows of metres in our template -> rows of the data's
    surface, faces = _remeshed(vertices @ to_data, right.f[:, ::-1] if side == "left" else right.f, _VOXEL_M * _CM)
    joints, tips = joints @ to_data, tips @ to_data
    weights = _carried_weights(surface, vertices @ to_data, right.f, right.lbs_weights)

    armature = _build_armature(name, joints, tips, rng)
    mesh = _build_mesh(name, surface, faces, armature)
    _give_weights(mesh, surface, weights, joints)
    _add_material(mesh, rng)
    armature.location = np.array([0, 0, 1]) + rng.uniform(-0.5, 0.5, 3)
    armature.rotation_euler = rng.uniform(-1, 1, 3)
    armature.scale = (1 / _CM,) * 3
    bpy.context.view_layer.update()
    turns = _global_turns(theta if side == "right" else theta * MIRROR_AXIS_ANGLE)
    return OtherHand(armature, mesh, side, turns)


def _tensors(*arrays: np.ndarray):
    import torch

    return (torch.as_tensor(array, dtype=torch.float32) for array in arrays)


def _global_turns(theta: np.ndarray) -> np.ndarray:
    turns = list(axis_angle_to_matrix(theta))
    for joint, parent in enumerate(PARENTS):
        if parent >= 0:
            turns[joint] = turns[parent] @ turns[joint]
    return np.array(turns)


def _tip_vertices(model) -> list[int]:
    along = [model.joints[last] - model.joints[last - 1] for last in range(3, 16, 3)]
    reach = [
        np.where(model.lbs_weights[:, 3 * k + 3] > 0.5, model.v_template @ along[k], -np.inf).argmax() for k in range(5)
    ]
    return [int(vertex) for vertex in reach]


def _remeshed(vertices: np.ndarray, faces: np.ndarray, voxel: float) -> tuple[np.ndarray, list]:
    """Another topology: quads from Blender's voxel remesher."""
    mesh = bpy.data.meshes.new("remeshed")
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    thing = bpy.data.objects.new("remeshed", mesh)
    bpy.context.scene.collection.objects.link(thing)
    modifier = thing.modifiers.new("Remesh", "REMESH")
    modifier.mode, modifier.voxel_size = "VOXEL", voxel
    bpy.context.view_layer.update()
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get()).to_mesh()
    surface = np.array([vertex.co for vertex in evaluated.vertices])
    quads = [tuple(polygon.vertices) for polygon in evaluated.polygons]
    bpy.data.objects.remove(thing)
    bpy.data.meshes.remove(mesh)
    return surface, quads


def _carried_weights(points: np.ndarray, vertices: np.ndarray, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """[N, 16] at the nearest point of the surface."""
    tree = BVHTree.FromPolygons(vertices.tolist(), faces.tolist())
    found = [tree.find_nearest(Vector(point)) for point in points]
    nearest, hit = np.array([place for place, *_ in found]), faces[[face for *_, face, _ in found]]
    first, second, third = np.moveaxis(vertices[hit], 1, 0)
    edges = np.stack([second - first, third - first], -1)  # [N, 3, 2]
    shares = np.einsum("nij,nj->ni", np.linalg.pinv(edges), nearest - first)
    shares = np.clip(np.c_[1 - shares.sum(1), shares], 0, 1)
    carried = np.einsum("nc,ncj->nj", shares, weights[hit])
    return carried / carried.sum(1, keepdims=True)


def _build_armature(name: str, joints: np.ndarray, tips: np.ndarray, rng) -> bpy.types.Object:
    armature = bpy.data.objects.new(name, bpy.data.armatures.new(name))
    bpy.context.scene.collection.objects.link(armature)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    out = joints[0] - joints[4]
    elbow = joints[0] + out / np.linalg.norm(out) * _FOREARM_M * _CM
    add = _BoneAdder(armature, rng)
    add(FOREARM, None, elbow, joints[0])
    add("wrist", FOREARM, joints[0], joints[4])
    for finger, first in enumerate(range(1, 14, 3)):
        above, chain = "wrist", [*joints[first : first + 3], tips[finger]]
        if finger < 4:
            base = 0.72 * joints[0] + 0.28 * joints[first] + 0.1 * (joints[first] - joints[4])
            above = add(METACARPALS[finger], "wrist", base, joints[first])
        for joint in range(3):
            above = add(JOINTS[first + joint], above, chain[joint], chain[joint + 1])
        onward = (chain[3] - chain[2]) / np.linalg.norm(chain[3] - chain[2])
        add(TIPS[finger], above, chain[3], chain[3] + onward * _TIP_BONE_M * _CM)
    bpy.ops.object.mode_set(mode="OBJECT")
    for bone in armature.pose.bones:
        bone.rotation_mode = "QUATERNION"
    return armature


class _BoneAdder:
    def __init__(self, armature: bpy.types.Object, rng):
        self.bones, self.rng = armature.data.edit_bones, rng

    def __call__(self, name: str, parent: str | None, head: np.ndarray, tail: np.ndarray) -> str:
        bone = self.bones.new(name)
        bone.head, bone.tail = head, tail
        bone.roll = self.rng.uniform(-np.pi, np.pi)
        bone.parent = self.bones[parent] if parent else None
        return name


def _build_mesh(name: str, surface: np.ndarray, faces: list, armature: bpy.types.Object) -> bpy.types.Object:
    data = bpy.data.meshes.new(f"{name} Skin")
    data.from_pydata(surface.tolist(), [], faces)
    data.polygons.foreach_set("use_smooth", np.ones(len(faces), bool))
    mesh = bpy.data.objects.new(f"{name} Skin", data)
    bpy.context.scene.collection.objects.link(mesh)
    mesh.parent = armature
    mesh.modifiers.new("Armature", "ARMATURE").object = armature
    return mesh


def _give_weights(mesh: bpy.types.Object, surface: np.ndarray, weights: np.ndarray, joints: np.ndarray) -> None:
    """The palm's weights are distributed over wrist, metacarpals and forearm."""
    along = joints[4] - joints[0]
    distal = (surface - joints[0]) @ along / (along @ along)  # 0 at the wrist, 1 at the knuckles
    palm = weights[:, 0].copy()
    of_forearm = palm * np.clip(0.5 - 4 * distal, 0, 1)
    of_metacarpals = (palm - of_forearm) * np.clip(2 * distal - 0.3, 0, 0.8)
    knuckles = joints[[1, 4, 7, 10]]
    near = np.linalg.norm(surface[:, None] - (joints[0] + distal[:, None, None] * (knuckles - joints[0])), axis=-1)
    share = np.exp(-((near / 1.2) ** 2)) + 1e-9  # cm
    share *= (of_metacarpals / share.sum(1))[:, None]
    own = np.concatenate([weights, share, of_forearm[:, None]], 1)
    own[:, 0] = palm - of_forearm - of_metacarpals
    for column, group in enumerate((*JOINTS, *METACARPALS, FOREARM)):
        vertex_group = mesh.vertex_groups.new(name=group)
        for vertex in np.flatnonzero(own[:, column] > 1e-3):
            vertex_group.add([int(vertex)], float(own[vertex, column]), "REPLACE")


def _read(elements, name: str, width: int = 1) -> np.ndarray:
    values = np.empty(len(elements) * width, np.float32 if name in ("co", "normal") else np.int32)
    elements.foreach_get(name, values)
    return values.reshape(-1, width) if width > 1 else values


def _add_material(mesh: bpy.types.Object, rng) -> None:
    """A painted material and a UV atlas: the back of the hand on the left half, the palm on the right."""
    data = mesh.data
    layer = data.uv_layers.new(name="Atlas")
    points = _read(data.vertices, "co", 3)
    places = ((points - points.min(0)) / (points.max(0) - points.min(0)))[_read(data.loops, "vertex_index")]
    is_palm = _read(data.polygons, "normal", 3)[:, 2] < 0
    palm_corners = np.repeat(is_palm, _read(data.polygons, "loop_total"))
    layer.data.foreach_set("uv", np.stack([places[:, 0] / 2 + palm_corners / 2, places[:, 1]], 1).ravel())
    image = bpy.data.images.new(f"{mesh.name} Paint", 32, 32)
    rows = np.ones((32, 32, 4), np.float32)
    rows[..., :3] = [0.75, 0.5, 0.4] + 0.15 * rng.normal(size=(32, 32, 3))
    image.pixels.foreach_set(np.clip(rows, 0, 1).ravel())
    image.pack()
    material = bpy.data.materials.new(f"{mesh.name} Paint")
    if bpy.app.version < (5, 0):  # later versions always use nodes, and warn
        material.use_nodes = True
    nodes = material.node_tree.nodes
    texture = nodes.new("ShaderNodeTexImage")
    texture.image = image
    material.node_tree.links.new(texture.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    data.materials.append(material)


def write_glb(hand: OtherHand, path: Path) -> Path:
    """Export with animation; bones lose their tails and rolls.

    In a process of its own, because one that has used this exporter and torch hangs at exit (Blender 4.5).
    """
    _select(hand)
    copy = path.with_suffix(".exported.blend")
    bpy.ops.wm.save_as_mainfile(filepath=str(copy), copy=True, check_existing=False)
    export = f"bpy.ops.export_scene.gltf(filepath={str(path)!r}, export_format='GLB', use_selection=True)"
    script = f"import bpy, os; bpy.ops.wm.open_mainfile(filepath={str(copy)!r}); {export}; os._exit(0)"
    subprocess.run([sys.executable, "-c", script], check=True, capture_output=True, timeout=60)
    copy.unlink()
    return path


def write_fbx(hand: OtherHand, path: Path) -> Path:
    """Export with animation, and with the leaf bones that Blender adds by default."""
    _select(hand)
    options = {"path_mode": "COPY", "embed_textures": True, "bake_anim_simplify_factor": 0}
    with warnings.catch_warnings():  # numpy 2.5 warns of what Blender 5.2's exporter does
        warnings.filterwarnings("ignore", "Setting the shape", DeprecationWarning)
        bpy.ops.export_scene.fbx(filepath=str(path), use_selection=True, **options)
    return path


def read_file(path: Path) -> bpy.types.Object:
    """Import a file into the scene; returns the armature."""
    before = set(bpy.data.objects)
    if path.suffix == ".fbx":
        bpy.ops.import_scene.fbx(filepath=str(path))
    else:
        bpy.ops.import_scene.gltf(filepath=str(path))
    bpy.context.view_layer.update()
    return next(thing for thing in bpy.data.objects if thing not in before and thing.type == "ARMATURE")


def remove(hand: OtherHand) -> None:
    """Remove the rig from the open file."""
    for thing in (hand.mesh, hand.armature):
        bpy.data.objects.remove(thing)
    bpy.data.orphans_purge(do_recursive=True)


def _select(hand: OtherHand) -> None:
    for thing in bpy.context.scene.objects:
        thing.select_set(thing in (hand.armature, hand.mesh))
    bpy.context.view_layer.objects.active = hand.armature
