"""Make `grasp.blend`: a hand that lifts and turns a tumbler for one second, rendered in its scene.

Run it with the Python that LiveHand is installed in: `python examples/make_grasp.py [OUT.blend]`.

World: Z up, metres. The hand is oriented like its template: fingers towards -X, palm to the front (-Y), thumb up. A
window at the left throws the tumbler's shade on the palm, and the fingers' on the tumbler.
"""

from pathlib import Path

import bpy
import numpy as np
from example_file import write_example
from livehand.backend.hand.gestures import FingerAxes, Gesture, theta_of
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.keyframes import keyframe_theta
from photo_set import add_camera, add_lamp, add_room

FRAMES = (1, 24)
SIZE_PX = (512, 512)
# Found by closing each finger, joint by joint, until it touches the tumbler.
GRASP = Gesture(
    {"index": (12, 41, 1), "middle": (18, 44, 6), "ring": (10, 32, 25), "pinky": (0, 0, 39)},
    thumb=((-4, 14, 16), (46, 0, 0), (20, 0, 0)),
)
RADIUS_M, HEIGHT_M, WALL_M = 0.031, 0.125, 0.0025
CENTRE_M = (-0.004, -0.0445, -0.066)  # of the tumbler's foot
CAMERA_M, TARGET_M, LENS_MM = (-0.33, -0.50, 0.31), (0.014, -0.025, 0.0), 92
WINDOW_M, WINDOW_SIDE_M, WINDOW_W, WINDOW_RGB = (-0.72, -0.42, 0.36), 0.22, 15.0, (1.0, 0.95, 0.88)
ROOM_RGBA = (0.06, 0.066, 0.08, 1)
GLAZE, TABLE = (0.10, 0.22, 0.30, 1), (0.36, 0.27, 0.19, 1)


def build_grasp() -> bpy.types.Scene:
    """Fill the open, empty file with the hand, the tumbler on its table, light and camera."""
    scene = bpy.context.scene
    scene.name = "Grasp"
    scene.frame_start, scene.frame_end = FRAMES
    scene.render.resolution_x, scene.render.resolution_y = SIZE_PX
    scene.render.filepath = "//out/grasp_"
    bpy.ops.livehand.set_engine()
    scene.livehand.mode = "SCENE"
    scene.render.film_transparent = False
    scene.cycles.samples, scene.cycles.use_denoising = 64, True
    bpy.ops.livehand.add_hand(side="right")
    hold(bpy.context.active_object)
    add_tumbler(scene)
    add_table(scene)
    add_lamp(scene, "Window", WINDOW_M, WINDOW_SIDE_M, WINDOW_W, WINDOW_RGB)
    add_room(scene, ROOM_RGBA)
    add_camera(scene, CAMERA_M, TARGET_M, LENS_MM)
    scene.frame_set(FRAMES[0])
    return scene


def hold(armature: bpy.types.Object) -> None:
    """Pose the fingers, and parent the hand to an empty that also carries the tumbler."""
    armature.rotation_euler = (0, 0, 0)
    theta = theta_of(GRASP.angles_deg(), FingerAxes.of_default_hand())
    keyframe_theta(RiggedHand.of(armature), np.array([theta, theta]), FRAMES)
    carrier = bpy.data.objects.new("Carrier", None)
    carrier.empty_display_size = 0.03
    bpy.context.scene.collection.objects.link(carrier)
    armature.parent = carrier
    for frame, lift, turn_deg in ((FRAMES[0], 0.0, 0.0), (FRAMES[1], 0.03, -18.0)):
        carrier.location.z, carrier.rotation_euler.z = lift, np.deg2rad(turn_deg)
        carrier.keyframe_insert("location", frame=frame)
        carrier.keyframe_insert("rotation_euler", frame=frame)


def add_tumbler(scene: bpy.types.Scene) -> None:
    """A glazed tumbler: a profile with a wall, a foot and a rounded rim, rotated about Z."""
    outer, inner = RADIUS_M, RADIUS_M - WALL_M
    rim = [(outer - WALL_M / 2 * (1 - np.cos(a)), HEIGHT_M + WALL_M / 2 * np.sin(a)) for a in np.linspace(0, np.pi, 9)]
    outline = [(0, 0), (outer - 0.004, 0), (outer - 0.001, 0.001), (outer, 0.004), *rim, (inner, 0.006), (0, 0.006)]
    steps = 96
    turns = np.linspace(0, 2 * np.pi, steps, endpoint=False)
    vertices = [(r * np.cos(turn), r * np.sin(turn), z) for r, z in outline for turn in turns]
    faces = [
        (k * steps + i, k * steps + (i + 1) % steps, (k + 1) * steps + (i + 1) % steps, (k + 1) * steps + i)
        for k in range(len(outline) - 1)
        for i in range(steps)
    ]
    tumbler = add_mesh(scene, "Tumbler", vertices, faces, GLAZE, roughness=0.25)
    tumbler.location = CENTRE_M
    tumbler.parent = scene.objects["Carrier"]
    for polygon in tumbler.data.polygons:
        polygon.use_smooth = True


def add_table(scene: bpy.types.Scene) -> None:
    """A table top that fills the image."""
    z = CENTRE_M[2]
    corners = [(-3, -3, z), (3, -3, z), (3, 3, z), (-3, 3, z)]
    add_mesh(scene, "Table", corners, [(0, 1, 2, 3)], TABLE, roughness=0.5)


def add_mesh(scene, name, vertices, faces, colour, roughness) -> bpy.types.Object:
    """A mesh object of one material."""
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices, [], faces)
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value, shader.inputs["Roughness"].default_value = colour, roughness
    mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    scene.collection.objects.link(thing)
    return thing


if __name__ == "__main__":
    write_example(build_grasp, Path(__file__).with_name("grasp.blend"))
