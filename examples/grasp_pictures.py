"""Picture six grasps, each from the palm and from the thumb's side: `python examples/grasp_pictures.py OUT.jpg`.

Run it with the Python that LiveHand is installed in, in a clone: the things are those of the nightly test of grasps.
"""

import sys
import tempfile
from pathlib import Path

import bpy
import livehand
import numpy as np
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.capture.node_graph import enable_nodes
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_hand_pose, write_theta
from livehand.tests.contact.things import HOLDS, given_pose, placed_mesh
from photo_set import add_camera, add_lamp, add_room
from PIL import Image

SIDE_PX, COLUMNS, SAMPLES, QUALITY = 420, 4, 64, 88
HOLDS_SHOWN = {  # number of the hold: who, and colour and roughness of the thing
    0: ("light", (0.62, 0.24, 0.05, 1), 0.35),
    10: ("middle", (0.04, 0.16, 0.09, 1), 0.15),
    8: ("deep", (0.30, 0.30, 0.32, 1), 0.30),
    15: ("deep", (0.05, 0.16, 0.24, 1), 0.60),
    16: ("light", (0.02, 0.05, 0.22, 1), 0.25),
    18: ("middle", (0.56, 0.31, 0.19, 1), 0.45),
}
UPRIGHT = (0, np.pi / 2, 0)  # fingers up, palm to the front (-Y), thumb to the right
VIEWS_M = {"palm": (-0.16, -0.78, 0.16), "thumb's side": (0.72, -0.34, 0.14)}  # from what is looked at
LENS_MM, SHARP_RAD = 150, 0.6
LAMPS = {  # place, m; side, m; power, W; colour
    "Window": ((-0.55, -0.60, 0.60), 0.45, 17.0, (1.0, 0.95, 0.88)),
    "Fill": ((0.80, -0.50, 0.30), 0.60, 6.0, (0.86, 0.92, 1.0)),
    "Edge": ((0.30, 0.60, 0.50), 0.30, 9.0, (0.90, 0.95, 1.0)),
}
ROOM_RGBA = (0.11, 0.12, 0.14, 1)


def picture_hold(number: int, folder: Path) -> list[Path]:
    """Build a hold in an empty file, grasp, and render its views."""
    bpy.ops.wm.read_homefile(use_empty=True)
    scene = bpy.context.scene
    scene.render.resolution_x = scene.render.resolution_y = SIDE_PX
    bpy.ops.livehand.set_engine()
    scene.livehand.mode = "SCENE"
    scene.render.film_transparent = False
    scene.cycles.samples, scene.cycles.use_denoising = SAMPLES, True
    bpy.ops.livehand.add_hand(side="right")
    armature = bpy.context.active_object
    person, rgba, roughness = HOLDS_SHOWN[number]
    armature.livehand.skin = person
    armature.location, armature.rotation_euler = (0, 0, 0), UPRIGHT
    write_theta(RiggedHand.of(armature), given_pose(HOLDS[number]).theta)
    thing = add_thing(scene, number, armature)
    thing.data.materials.append(coloured(thing.name, rgba, roughness))
    bpy.context.view_layer.update()
    thing.select_set(True)
    armature.select_set(True)
    bpy.context.view_layer.objects.active = armature
    bpy.ops.livehand.grasp()
    for name, (place_m, side_m, power_w, rgb) in LAMPS.items():
        add_lamp(scene, name, place_m, side_m, power_w, rgb)
    add_room(scene, ROOM_RGBA)
    return [render_from(scene, armature, view, folder / f"{number:02d}_{at}.png") for at, view in enumerate(VIEWS_M)]


def add_thing(scene: bpy.types.Scene, number: int, armature: bpy.types.Object) -> bpy.types.Object:
    """What is held, where the hold has it in the hand."""
    placed = placed_mesh(HOLDS[number], load_default_hand())
    mesh = bpy.data.meshes.new(HOLDS[number].thing)
    mesh.from_pydata(placed.vertices.tolist(), [], placed.faces.tolist())
    mesh.polygons.foreach_set("use_smooth", np.ones(len(placed.faces), bool))
    mesh.set_sharp_from_angle(angle=SHARP_RAD)
    thing = bpy.data.objects.new(mesh.name, mesh)
    scene.collection.objects.link(thing)
    thing.parent = armature
    return thing


def coloured(name: str, rgba: tuple[float, ...], roughness: float) -> bpy.types.Material:
    """A plain material."""
    material = bpy.data.materials.new(name)
    shader = enable_nodes(material).nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value, shader.inputs["Roughness"].default_value = rgba, roughness
    return material


def render_from(scene: bpy.types.Scene, armature: bpy.types.Object, view: str, path: Path) -> Path:
    """Render the hand and what it holds."""
    model, depsgraph = load_default_hand(), bpy.context.evaluated_depsgraph_get()
    hand = posed_vertices(model, read_hand_pose(armature, depsgraph))[model.arm_weights == 0]
    points = hand @ np.array(armature.matrix_world)[:3, :3].T
    target = (points.min(0) + points.max(0)) / 2
    if scene.camera:
        bpy.data.objects.remove(scene.camera)
    add_camera(scene, tuple(target + VIEWS_M[view]), tuple(target), LENS_MM)
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return path


def sheet_of(pictures: list[Path]) -> Image.Image:
    """All pictures, in rows."""
    rows = -(-len(pictures) // COLUMNS)
    sheet = Image.new("RGB", (COLUMNS * SIDE_PX, rows * SIDE_PX))
    for number, path in enumerate(pictures):
        with Image.open(path) as picture:
            sheet.paste(picture.convert("RGB"), (number % COLUMNS * SIDE_PX, number // COLUMNS * SIDE_PX))
    return sheet


if __name__ == "__main__":
    livehand.register()
    try:
        with tempfile.TemporaryDirectory() as folder:
            shown = [path for number in HOLDS_SHOWN for path in picture_hold(number, Path(folder))]
            sheet_of(shown).save(sys.argv[1], quality=QUALITY, optimize=True)
    finally:
        livehand.unregister()
