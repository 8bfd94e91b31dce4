"""Make `edited.blend`: one avatar on four surfaces, three of them edited with Blender's tools.

From the left: unedited; a shape key with claws; a lattice that swells the fingers; a twist.
Run it with the Python that LiveHand is installed in: `python examples/make_edited.py [OUT.blend]`.
"""

from pathlib import Path

import bpy
import numpy as np
from example_file import write_example
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.light.studio import add_studio
from livehand.livehand_blender.rig.hand import RiggedHand, mesh_of
from livehand.livehand_blender.rig.pose import write_theta

SIZE_PX = (1152, 432)
APART_M = 0.175
CLAW_M = 0.022  # by which a fingertip grows
SLENDER = 0.75  # how much thinner it gets
SWOLLEN = 1.9  # across the fingers
TWIST_DEG = 130


def build_edited() -> bpy.types.Scene:
    """Fill the open, empty file with four hands in a row and a camera."""
    scene = bpy.context.scene
    scene.name = "Edited"
    scene.frame_start = scene.frame_end = 1
    scene.render.resolution_x, scene.render.resolution_y = SIZE_PX
    bpy.ops.livehand.set_engine()
    for place, edit in enumerate((None, draw_claws, swell_fingers, twist)):
        mesh = add_hand((place - 1.5) * APART_M)
        if edit:
            edit(mesh)
    add_camera(scene)
    add_studio(bpy.context)
    return scene


def add_hand(x_m: float) -> bpy.types.Object:
    """Add an open hand, fingers up, at a position in the row; returns its mesh."""
    bpy.ops.livehand.add_hand()
    armature = bpy.context.active_object
    armature.location.x = x_m
    write_theta(RiggedHand.of(armature), theta_of(GESTURES["open"].angles_deg(), FingerAxes.of_default_hand()))
    return mesh_of(armature)


def draw_claws(mesh: bpy.types.Object) -> None:
    """A shape key, as from sculpting: fingertips that become longer and thinner."""
    hand = load_default_hand()
    axes = FingerAxes.of_default_hand()
    vertices = hand.v_template.copy()
    for joint in (3, 6, 9, 12, 15):
        along = axes.bone[joint]
        own = np.flatnonzero(hand.lbs_weights[:, joint] > 0.5)
        offset = vertices[own] - hand.joints[joint]
        height = offset @ along
        share = np.clip(height / height.max(), 0, 1)[:, None] ** 2
        across = offset - height[:, None] * along
        vertices[own] += share * (CLAW_M * along - SLENDER * across)
    key = mesh.shape_key_add(name="Claws", from_mix=False)
    key.data.foreach_set("co", vertices.astype(np.float32).ravel())
    key.value = 1.0


def swell_fingers(mesh: bpy.types.Object) -> None:
    """A lattice around the posed hand, wider where the fingers are (-X of the hand)."""
    lattice = bpy.data.objects.new("Lattice", bpy.data.lattices.new("Lattice"))
    bpy.context.scene.collection.objects.link(lattice)
    lattice.parent = mesh.parent
    lattice.location, lattice.scale = (-0.02, 0, 0.0), (0.26, 0.09, 0.2)
    lattice.data.points_u, lattice.data.points_v, lattice.data.points_w = 4, 2, 2
    for point in lattice.data.points:
        if point.co.x < 0:
            point.co_deform.y *= SWOLLEN
            point.co_deform.z *= SWOLLEN
    lattice.hide_render = True
    mesh.modifiers.new("Lattice", "LATTICE").object = lattice


def twist(mesh: bpy.types.Object) -> None:
    """A twist about the hand's length, from the wrist to the fingertips."""
    modifier = mesh.modifiers.new("Twist", "SIMPLE_DEFORM")
    modifier.deform_method, modifier.deform_axis = "TWIST", "X"
    modifier.angle = np.deg2rad(TWIST_DEG)


def add_camera(scene: bpy.types.Scene) -> None:
    """In front of the row (-Y)."""
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(camera)
    scene.camera = camera
    camera.location, camera.rotation_euler = (-0.015, -1.2, 0.0), (np.pi / 2, 0, 0)
    camera.data.lens, camera.data.clip_start, camera.data.clip_end = 60, 0.01, 10


if __name__ == "__main__":
    write_example(build_edited, Path(__file__).with_name("edited.blend"))
