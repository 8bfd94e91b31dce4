"""A lamp that circles the example hand: a film strip by LiveHand, above the same by Cycles with the captures' own skin.

python examples/circling_lamp.py OUT.png [--steps 6] [--frame 1] [--samples 64]
"""

import argparse
import tempfile
from pathlib import Path

import bpy
import livehand
import numpy as np
from cycles_truth import put_skin_in, render
from livehand.livehand_blender.hands.shot import world_vertices
from livehand.livehand_blender.light.studio import remove_studio
from livehand.livehand_blender.rig.hand import RiggedHand
from mathutils import Vector
from PIL import Image

SHOT = Path(__file__).with_name("wave.blend")
DISTANCE_M, HEIGHT_M, SIDE_M, POWER_W = 0.6, 0.25, 0.15, 9.0
WORLD_RGBA = (0.02, 0.022, 0.027, 1)


def open_dark_shot(args: argparse.Namespace) -> bpy.types.Scene:
    """The example at a frame, in an almost black world."""
    bpy.ops.wm.open_mainfile(filepath=str(SHOT))
    scene = bpy.context.scene
    remove_studio(scene)
    scene.world = bpy.data.worlds.new("Dark")
    scene.world.use_nodes = True
    scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = WORLD_RGBA
    scene.frame_set(args.frame)
    scene.render.resolution_percentage = args.percent
    scene.cycles.samples = args.samples
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    armature = RiggedHand.all_in(scene)[0].armature
    armature.livehand.hair = 0  # as on the skin of captures
    if args.avatar:
        armature.livehand.avatar_path = str(args.avatar.resolve())
    return scene


def add_lamp(scene: bpy.types.Scene) -> bpy.types.Object:
    """A square lamp."""
    data = bpy.data.lights.new("Circling", "AREA")
    data.size, data.energy = SIDE_M, POWER_W
    lamp = bpy.data.objects.new("Circling", data)
    scene.collection.objects.link(lamp)
    return lamp


def put_lamp(lamp: bpy.types.Object, middle: Vector, azimuth_rad: float) -> None:
    """Put the lamp on its circle, 0 in front (-Y), and turn it towards the middle."""
    offset = Vector((DISTANCE_M * np.sin(azimuth_rad), -DISTANCE_M * np.cos(azimuth_rad), HEIGHT_M))
    lamp.location, lamp.rotation_euler = middle + offset, offset.to_track_quat("Z", "Y").to_euler()


def strip(args: argparse.Namespace, folder: Path, is_truth: bool) -> np.ndarray:
    """[H, steps * W, 4] of all places of the lamp."""
    scene = open_dark_shot(args)
    mesh = RiggedHand.all_in(scene)[0].mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    middle = Vector(world_vertices(mesh).mean(0).tolist())
    if is_truth:
        put_skin_in(scene, folder)
    lamp = add_lamp(scene)
    pictures = []
    for azimuth_rad in np.linspace(-0.75 * np.pi, 0.75 * np.pi, args.steps):
        put_lamp(lamp, middle, azimuth_rad)
        pictures.append(render(scene, folder / "picture.png"))
    return np.hstack(pictures)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("output", type=Path)
    parser.add_argument("--steps", type=int, default=6)
    parser.add_argument("--frame", type=int, default=1)
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--percent", type=int, default=100, help="of the shot's resolution")
    parser.add_argument("--avatar", type=Path, help="in place of the shot's own")
    args = parser.parse_args()
    livehand.register()
    try:
        with tempfile.TemporaryDirectory() as folder:
            rows = [strip(args, Path(folder), is_truth) for is_truth in (False, True)]
    finally:
        livehand.unregister()
    straight = np.vstack(rows)
    colour = straight[..., :3] * (straight[..., 3:] / 255.0)
    Image.fromarray(colour.round().astype(np.uint8)).save(args.output)


if __name__ == "__main__":
    main()
