"""Compare `grasp.blend` as rendered by LiveHand with the captures' own skin in the same shot, rendered by Cycles.

    python examples/grasp_truth.py OUT_DIR [--frame 12] [--samples 64]

writes livehand.png, cycles.png and both.png (LiveHand left), and prints the intersection over union of the hand's
visible silhouettes (occlusion by the tumbler included).
"""

import argparse
from pathlib import Path

import bpy
import livehand
import numpy as np
from livehand.backend.hand.builtin.detailed_surface import detailed_surface
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.capture.bake import bake_skin
from livehand.livehand_blender.capture.skin import SkinTone, baked_material
from livehand.livehand_blender.capture.surface import SkinSurface
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_pose
from PIL import Image

BLEND = Path(__file__).with_name("grasp.blend")


def open_shot(frame: int, samples: int) -> bpy.types.Scene:
    """The example at a frame."""
    bpy.ops.wm.open_mainfile(filepath=str(BLEND))
    scene = bpy.context.scene
    scene.frame_set(frame)
    scene.cycles.samples = samples
    scene.render.image_settings.file_format = "PNG"
    return scene


def put_skin_in(scene: bpy.types.Scene, folder: Path) -> bpy.types.Object:
    """Replace the hand with the captures' surface in the same pose, for Cycles."""
    (hand,) = RiggedHand.all_in(scene)
    pose = read_pose(hand, bpy.context.evaluated_depsgraph_get())
    place = hand.armature.matrix_world.copy()
    model = load_default_hand()
    surface = SkinSurface.create(model, detailed_surface(model))
    scene.render.engine = "CYCLES"
    bpy.ops.object.select_all(action="DESELECT")  # selected objects would be baked
    samples = scene.cycles.samples
    maps = bake_skin(surface.object, folder / "skin", SkinTone())
    surface.object.data.materials.append(baked_material(maps, SkinTone()))
    surface.set_pose(pose)
    surface.object.matrix_world = place
    hand.mesh.hide_render = True
    scene.cycles.samples, scene.cycles.use_denoising = samples, True  # baking has changed them
    return surface.object


def render(scene: bpy.types.Scene, path: Path) -> np.ndarray:
    """[H, W, 4] levels of the rendered scene."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return np.array(Image.open(path).convert("RGBA"))


def our_coverage(scene: bpy.types.Scene, folder: Path) -> np.ndarray:
    """[H, W] the hand's coverage: what is equal in a black scene and a white one. Changes the scene."""
    scene.world, scene.cycles.samples, scene.view_settings.view_transform = None, 1, "Raw"
    flat = bpy.data.materials.new("Flat")
    flat.use_nodes = True
    shader = flat.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = shader.inputs["Emission Color"].default_value = (0, 0, 0, 1)
    scene.view_layers[0].material_override = flat
    black = render(scene, folder / "black.png")[..., 0]
    shader.inputs["Emission Color"].default_value = (1, 1, 1, 1)
    shader.inputs["Emission Strength"].default_value = 1
    white = render(scene, folder / "white.png")[..., 0]
    return 1 - (white.astype(float) - black) / 255


def true_coverage(scene: bpy.types.Scene, hand: bpy.types.Object, folder: Path) -> np.ndarray:
    """[H, W] the coverage by Cycles: everything but the hand is a holdout. Changes the scene."""
    for thing in scene.objects:
        if thing.type == "MESH" and thing != hand:
            thing.is_holdout = True
    scene.render.film_transparent = True
    return render(scene, folder / "cut.png")[..., 3] / 255


def iou(one: np.ndarray, other: np.ndarray) -> float:
    """Intersection over union of coverages."""
    return float(np.minimum(one, other).sum() / np.maximum(one, other).sum())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--frame", type=int, default=12)
    parser.add_argument("--samples", type=int, default=64)
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    livehand.register()
    try:
        scene = open_shot(args.frame, args.samples)
        ours = render(scene, args.folder / "livehand.png")
        our_hand = our_coverage(scene, args.folder)
        scene = open_shot(args.frame, args.samples)
        skin = put_skin_in(scene, args.folder)
        truth = render(scene, args.folder / "cycles.png")
        true_hand = true_coverage(scene, skin, args.folder)
    finally:
        livehand.unregister()
    Image.fromarray(np.hstack([ours, truth])[..., :3]).save(args.folder / "both.png")
    print(f"IoU of the silhouettes: {iou(our_hand, true_hand):.4f}")


if __name__ == "__main__":
    main()
