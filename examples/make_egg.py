"""Make `egg.blend`: a close-up of a hand that holds an egg by its fingertips, its forearm in the frame.

Run it with the Python that LiveHand is installed in: `python examples/make_egg.py [OUT.blend]`.

World: Z up, metres. The hand is oriented like its template: fingers towards -X, palm to the front (-Y), thumb up.
"""

from pathlib import Path

import bpy
import numpy as np
from example_file import write_example
from livehand.backend.hand.gestures import FingerAxes, Gesture, theta_of
from livehand.livehand_blender.capture.node_graph import enable_nodes
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import write_theta
from photo_set import add_camera, add_lamp, add_room

SIZE_PX = (960, 640)
# Found by least squares: the pads of four fingers touch the egg, and none passes into it.
GRASP = Gesture(
    {"index": (33, 30, 17), "middle": (35, 38, 22), "ring": (41, 45, 22), "pinky": (44, 42, 21)},
    {"index": 4, "middle": 1, "ring": -5, "pinky": -9},
    ((7, -8, 13), (2, 0, 0), (7, 0, 0)),
)
EGG_M, EGG_RADIUS_M, EGG_LENGTH_M, EGG_TAPER = (-0.0001, -0.0499, 0.0183), 0.0215, 0.055, 0.14
TURN_DEG = (-6, 40, 0)  # of the whole hand: the fingers higher than the elbow
CAMERA_M, TARGET_M, LENS_MM = (-0.25, -0.80, 0.16), (0.012, -0.02, -0.012), 120
LAMPS = {  # place, m; side, m; power, W; colour. A window at the left above, an edge of light from behind
    "Window": ((-0.60, -0.46, 0.50), 0.40, 15.0, (1.0, 0.95, 0.88)),
    "Edge": ((0.35, 0.45, 0.35), 0.25, 6.0, (0.85, 0.92, 1.0)),
}
ROOM_RGBA, WALL_RGBA, SHELL_RGBA = (0.030, 0.034, 0.042, 1), (0.045, 0.055, 0.06, 1), (0.56, 0.31, 0.19, 1)


def build_egg() -> bpy.types.Scene:
    """Fill the open, empty file with the hand, the egg, a wall behind them, light and camera."""
    scene = bpy.context.scene
    scene.name = "Egg"
    scene.frame_start = scene.frame_end = 1
    scene.render.resolution_x, scene.render.resolution_y = SIZE_PX
    scene.render.filepath = "//out/egg_"
    bpy.ops.livehand.set_engine()
    scene.livehand.mode = "SCENE"
    scene.render.film_transparent = False
    scene.cycles.samples, scene.cycles.use_denoising = 128, True
    bpy.ops.livehand.add_hand(side="right")
    armature = bpy.context.active_object
    armature.rotation_euler = np.deg2rad(TURN_DEG)
    write_theta(RiggedHand.of(armature), theta_of(GRASP.angles_deg(), FingerAxes.of_default_hand()))
    add_egg(scene).parent = armature
    add_wall(scene)
    for name, (place_m, side_m, power_w, rgb) in LAMPS.items():
        add_lamp(scene, name, place_m, side_m, power_w, rgb)
    add_room(scene, ROOM_RGBA)
    add_camera(scene, CAMERA_M, TARGET_M, LENS_MM)
    return scene


def add_egg(scene: bpy.types.Scene) -> bpy.types.Object:
    """An egg: an ellipsoid that is slimmer towards its upper end, with a brown, speckled shell."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=96, ring_count=64, radius=1)
    egg = bpy.context.active_object
    egg.name = egg.data.name = "Egg"
    for vertex in egg.data.vertices:
        slim = EGG_RADIUS_M * (1 - EGG_TAPER * vertex.co.z) / (1 + EGG_TAPER**2 / 2)
        vertex.co = (slim * vertex.co.x, slim * vertex.co.y, EGG_LENGTH_M / 2 * vertex.co.z)
    for polygon in egg.data.polygons:
        polygon.use_smooth = True
    egg.location = EGG_M
    egg.data.materials.append(shell())
    return egg


def shell() -> bpy.types.Material:
    """Brown eggshell: speckles of pigment, fine pores, a dull gloss."""
    material = bpy.data.materials.new("Eggshell")
    graph = enable_nodes(material)
    shader = graph.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = 0.42
    shader.inputs["Subsurface Weight"].default_value = 0.15
    shader.inputs["Subsurface Radius"].default_value = (0.003, 0.002, 0.0012)
    place = graph.nodes.new("ShaderNodeTexCoord").outputs["Object"]

    def noise(scale: float, detail: float) -> bpy.types.NodeSocket:
        node = graph.nodes.new("ShaderNodeTexNoise")
        node.inputs["Scale"].default_value, node.inputs["Detail"].default_value = scale, detail
        graph.links.new(place, node.inputs["Vector"])
        return node.outputs["Factor" if "Factor" in node.outputs else "Fac"]

    ramp = graph.nodes.new("ShaderNodeValToRGB")
    low, high = ramp.color_ramp.elements
    low.position, low.color = 0.30, (*(0.55 * value for value in SHELL_RGBA[:3]), 1)
    high.position, high.color = 0.44, SHELL_RGBA
    graph.links.new(noise(700, 2), ramp.inputs["Fac"])
    graph.links.new(ramp.outputs["Color"], shader.inputs["Base Color"])
    bump = graph.nodes.new("ShaderNodeBump")
    bump.inputs["Distance"].default_value, bump.inputs["Strength"].default_value = 0.00006, 0.6
    graph.links.new(noise(2600, 1), bump.inputs["Height"])
    graph.links.new(bump.outputs["Normal"], shader.inputs["Normal"])
    return material


def add_wall(scene: bpy.types.Scene) -> None:
    """A dull wall half a metre behind the hand."""
    mesh = bpy.data.meshes.new("Wall")
    mesh.from_pydata([(-3, 0.5, -3), (3, 0.5, -3), (3, 0.5, 3), (-3, 0.5, 3)], [], [(0, 1, 2, 3)])
    material = bpy.data.materials.new("Wall")
    shader = enable_nodes(material).nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value, shader.inputs["Roughness"].default_value = WALL_RGBA, 0.9
    mesh.materials.append(material)
    scene.collection.objects.link(bpy.data.objects.new("Wall", mesh))


if __name__ == "__main__":
    write_example(build_egg, Path(__file__).with_name("egg.blend"))
