"""Make `follow.blend`: a hand that follows another rig, here a stick figure's hand with Mixamo's bone names.

Run it with the Python that LiveHand is installed in: `python examples/make_follow.py [OUT.blend]`. The collection
*Sticks* contains the rig and its meshes, *LiveHand* the hand that follows it; hide one to render the other alone.
"""

from pathlib import Path

import bpy
import numpy as np
from example_file import write_example
from livehand.backend.hand.model import JOINT_NAMES
from livehand.livehand_blender.light.studio import add_studio
from mathutils import Euler, Matrix, Vector

SIZE_PX = (384, 448)
FRAMES = {1: "open", 13: "pinch", 25: "fist", 37: "open"}
# A flat right hand, palm down (-Z), fingers along +Y, thumb to -X: each finger's knuckle, and its bones' lengths, m.
KNUCKLES_M = {"Index": (-0.026, 0.094), "Middle": (-0.003, 0.099), "Ring": (0.019, 0.094), "Pinky": (0.039, 0.082)}
LENGTHS_M = {
    "Index": (0.043, 0.026, 0.022),
    "Middle": (0.047, 0.030, 0.023),
    "Ring": (0.043, 0.028, 0.023),
    "Pinky": (0.034, 0.021, 0.020),
}
THUMB_M = ((-0.022, 0.022, -0.01), (-0.052, 0.048, -0.022), (-0.074, 0.072, -0.031), (-0.09, 0.094, -0.036))
# Degrees of flexion of each finger's three joints; of the thumb's: under the palm, and across it.
POSES = {
    "open": {"Thumb": ((0, 0), (0, 0), (0, 0))},
    "pinch": {
        "Index": (52, 55, 30),
        "Middle": (30, 30, 15),
        "Ring": (20, 25, 12),
        "Pinky": (12, 20, 10),
        "Thumb": ((48, 12), (8, 14), (0, 24)),
    },
    "fist": {
        "Index": (72, 95, 55),
        "Middle": (76, 95, 55),
        "Ring": (78, 92, 55),
        "Pinky": (80, 90, 55),
        "Thumb": ((52, 26), (8, 34), (0, 52)),
    },
}
BONE = "mixamorig:RightHand{}"
STICK_M, BALL_M = 0.004, 0.0065


def build_follow() -> bpy.types.Scene:
    """Fill the open, empty file: the sticks, the hand, a camera, studio lights."""
    scene = bpy.context.scene
    scene.name = "Follow"
    scene.frame_start, scene.frame_end = min(FRAMES), max(FRAMES)
    scene.render.resolution_x, scene.render.resolution_y = SIZE_PX
    rig = build_rig(collection("Sticks"))
    for frame, pose in FRAMES.items():
        key_pose(rig, pose, frame)
    scene.frame_set(scene.frame_start)
    collection("LiveHand")
    bpy.ops.livehand.add_hand()
    follow(bpy.context.active_object, rig)
    add_camera(scene)
    add_studio(bpy.context)
    bpy.ops.livehand.set_engine()
    return scene


def collection(name: str) -> bpy.types.Collection:
    """A new collection, which becomes active."""
    made = bpy.data.collections.new(name)
    bpy.context.scene.collection.children.link(made)
    bpy.context.view_layer.active_layer_collection = bpy.context.view_layer.layer_collection.children[name]
    return made


def chains() -> dict[str, list[Vector]]:
    """Each finger's joints and tip."""
    found = {"Thumb": [Vector(place) for place in THUMB_M]}
    for finger, (x, y) in KNUCKLES_M.items():
        ends = y + np.cumsum([0.0, *LENGTHS_M[finger]])
        found[finger] = [Vector((x, end, 0.0)) for end in ends]
    return found


def build_rig(target: bpy.types.Collection) -> bpy.types.Object:
    """The armature, fingers up, with a stick and a ball for every bone."""
    rig = bpy.data.objects.new("Stick Figure", bpy.data.armatures.new("Stick Figure"))
    target.objects.link(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    bones = rig.data.edit_bones
    hand = bones.new(BONE.format(""))
    hand.head, hand.tail = (0, 0, 0), (0, 0.05, 0)
    for finger, points in chains().items():
        above = hand
        ends = [*points[1:], points[-1] + Vector((0, 0.01, 0))]
        for number, (head, tail) in enumerate(zip(points, ends, strict=True)):
            bone = bones.new(BONE.format(f"{finger}{number + 1}"))
            bone.head, bone.tail, bone.parent = head, tail, above
            above = bone
    bpy.ops.object.mode_set(mode="OBJECT")
    # Fingers up, the back of the hand to the front (-Y), rotated a little to show the thumb.
    rig.matrix_world = Matrix.Rotation(np.deg2rad(25), 4, "Z") @ Matrix.Rotation(np.pi / 2, 4, "X")
    bpy.context.view_layer.update()
    add_sticks(rig, target)
    return rig


def add_sticks(rig: bpy.types.Object, target: bpy.types.Collection) -> None:
    """Bones of the fingers as sticks, joints as balls, the palm as sticks from the wrist."""
    stick, ball = bpy.data.materials.new("Stick"), bpy.data.materials.new("Ball")
    for material, colour in ((stick, (0.55, 0.57, 0.6, 1)), (ball, (0.9, 0.25, 0.05, 1))):
        if bpy.app.version < (5, 0):  # later versions always use nodes, and warn
            material.use_nodes = True
        material.node_tree.nodes["Principled BSDF"].inputs["Base Color"].default_value = colour
    for bone in rig.data.bones:
        if bone.name != BONE.format(""):
            add_part(rig, bone.name, target, ball, bone.head_local, bone.head_local)
        if bone.children and bone.name != BONE.format(""):
            add_part(rig, bone.name, target, stick, bone.head_local, bone.tail_local)
        if bone.parent and bone.parent.name == BONE.format(""):
            add_part(rig, bone.parent.name, target, stick, Vector((0, 0, 0)), bone.head_local)
    add_part(rig, BONE.format(""), target, ball, Vector((0, 0, 0)), Vector((0, 0, 0)))


def add_part(
    rig: bpy.types.Object,
    bone: str,
    target: bpy.types.Collection,
    material: bpy.types.Material,
    start: Vector,
    end: Vector,
) -> None:
    """A stick from start to end (a ball if they coincide), parented to a bone; positions in the rig's rest pose."""
    along = end - start
    if along.length:
        bpy.ops.mesh.primitive_cylinder_add(radius=STICK_M, depth=along.length, vertices=24)
    else:
        bpy.ops.mesh.primitive_ico_sphere_add(radius=BALL_M, subdivisions=3)
    part = bpy.context.object
    bpy.ops.object.shade_smooth()
    part.data.materials.append(material)
    turn = along.to_track_quat("Z", "Y").to_matrix().to_4x4() if along.length else Matrix()
    part.parent, part.parent_type, part.parent_bone = rig, "BONE", bone
    part.matrix_world = rig.matrix_world @ Matrix.Translation((start + end) / 2) @ turn
    for other in part.users_collection:
        other.objects.unlink(part)
    target.objects.link(part)


def key_pose(rig: bpy.types.Object, pose: str, frame: int) -> None:
    """Key all fingers."""
    for finger in ("Thumb", *KNUCKLES_M):
        angles = POSES[pose].get(finger, (0, 0, 0))
        for number, angle in enumerate(angles, 1):
            bone = rig.pose.bones[BONE.format(f"{finger}{number}")]
            bone.rotation_mode = "XYZ"
            turn = thumb_turn(bone, *angle) if isinstance(angle, tuple) else Euler((-np.deg2rad(angle), 0, 0))
            bone.rotation_euler = turn
            bone.keyframe_insert("rotation_euler", frame=frame)


def thumb_turn(bone: bpy.types.PoseBone, under_deg: float, across_deg: float) -> Euler:
    """Rotation about the palm's Y and Z, in the bone's own axes."""
    rest = bone.bone.matrix_local.to_3x3()
    turn = Matrix.Rotation(-np.deg2rad(across_deg), 3, "Z") @ Matrix.Rotation(-np.deg2rad(under_deg), 3, "Y")
    return (rest.transposed() @ turn @ rest).to_euler("XYZ")


def follow(hand: bpy.types.Object, rig: bpy.types.Object) -> None:
    """The same as in the panel: choose the rig, guess its bones, follow."""
    other = hand.livehand.other_rig
    other.armature = rig
    bpy.ops.livehand.guess_bones()
    assert all(getattr(other, joint) for joint in JOINT_NAMES)
    bpy.ops.livehand.follow_rig()


def add_camera(scene: bpy.types.Scene) -> None:
    """In front (-Y)."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location, camera.rotation_euler = (-0.01, -0.75, 0.08), (np.pi / 2, 0, 0)
    camera.data.lens, camera.data.clip_start, camera.data.clip_end = 100, 0.01, 10


if __name__ == "__main__":
    write_example(build_follow, Path(__file__).with_name("follow.blend"))
