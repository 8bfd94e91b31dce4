"""Compare frames of a shot of one right hand, rendered by LiveHand, with the captures' own skin rendered by Cycles.

    python examples/cycles_truth.py OUT_DIR [--shot grasp.blend] [--frames 12] [--samples 64]

For every frame it writes livehand_F.png, cycles_F.png and both_F.png (LiveHand left), and prints the intersection over
union of the hand's visible silhouettes and both pictures' contrast by scale (`backend/evaluation/contrast_bands.py`).
"""

import argparse
from pathlib import Path

import bpy
import livehand
import numpy as np
import torch
from livehand.backend.evaluation.contrast_bands import contrast
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.teacher.detailed_surface import detailed_surface
from livehand.livehand_blender.capture.bake import bake_skin
from livehand.livehand_blender.capture.skin import SkinTone, baked_material
from livehand.livehand_blender.capture.surface import SkinSurface
from livehand.livehand_blender.hands.shot import world_vertices
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import read_pose
from livehand.livehand_blender.scene.camera import read_camera
from PIL import Image


def open_shot(args: argparse.Namespace, frame: int) -> bpy.types.Scene:
    """The shot at a frame."""
    bpy.ops.wm.open_mainfile(filepath=str(args.shot))
    scene = bpy.context.scene
    scene.frame_set(frame)
    scene.cycles.samples = args.samples
    scene.render.image_settings.file_format, scene.render.image_settings.color_mode = "PNG", "RGBA"
    if args.avatar:
        RiggedHand.all_in(scene)[0].armature.livehand.avatar_path = str(args.avatar.resolve())
    return scene


def put_skin_in(scene: bpy.types.Scene, folder: Path) -> bpy.types.Object:
    """Replace the hand with the captures' surface in the same pose, for Cycles."""
    (hand,) = RiggedHand.all_in(scene)
    pose = read_pose(hand, bpy.context.evaluated_depsgraph_get())
    place = hand.armature.matrix_world.copy()
    tone = SkinTone()
    model = load_default_hand()
    surface = SkinSurface.create(model, detailed_surface(model))
    scene.render.engine = "CYCLES"
    bpy.ops.object.select_all(action="DESELECT")  # selected objects would be baked
    maps = bake_skin(surface.object, folder / "skin", tone)
    surface.object.data.materials.append(baked_material(maps, tone))
    surface.set_pose(pose)
    surface.object.matrix_world = place
    hand.mesh.hide_render = True
    scene.cycles.use_denoising = True
    return surface.object


def render(scene: bpy.types.Scene, path: Path) -> np.ndarray:
    """[H, W, 4] levels of the rendered scene, straight alpha."""
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return np.array(Image.open(path).convert("RGBA"))


def our_coverage(scene: bpy.types.Scene, folder: Path) -> np.ndarray:
    """[H, W] the hand's coverage: what is equal in a black scene and a white one. Changes the scene."""
    if scene.livehand.mode == "HAND":
        return render(scene, folder / "cut.png")[..., 3] / 255
    scene.livehand.light = "CAPTURE"
    scene.world, scene.cycles.samples, scene.view_settings.view_transform = None, 1, "Raw"
    for thing in scene.objects:
        if thing.type == "LIGHT":
            thing.hide_render = True
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


def pixel_size_mm(scene: bpy.types.Scene) -> float:
    """Width of a pixel at the middle of the hand."""
    camera = read_camera(scene.camera, scene.render)
    (hand,) = RiggedHand.all_in(scene)
    middle = world_vertices(hand.mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())).mean(0)
    depth_m = float((middle - camera.cam2world[:3, 3]) @ camera.cam2world[:3, 2])
    return 1e3 * abs(depth_m / camera.K[0, 0])


def contrast_line(image: np.ndarray, coverage: np.ndarray, mm_per_px: float) -> str:
    """Figures of the hand in a picture."""
    colour = torch.from_numpy(image[..., :3] / np.float32(255))
    figures = contrast(colour, torch.from_numpy(coverage > 0.5), mm_per_px)
    return "  ".join(f"{name} {value:5.2f}" for name, value in figures.items())


def compare(args: argparse.Namespace, frame: int) -> None:
    """Render a frame both ways, save the pictures, print the figures."""
    scene = open_shot(args, frame)
    mm_per_px = pixel_size_mm(scene)
    ours = render(scene, args.folder / f"livehand_{frame}.png")
    our_hand = our_coverage(scene, args.folder)
    scene = open_shot(args, frame)
    skin = put_skin_in(scene, args.folder)
    truth = render(scene, args.folder / f"cycles_{frame}.png")
    true_hand = true_coverage(scene, skin, args.folder)
    Image.fromarray(np.hstack([ours, truth])).save(args.folder / f"both_{frame}.png")
    print(f"frame {frame}: IoU of the silhouettes {iou(our_hand, true_hand):.4f}")
    print(f"  LiveHand  {contrast_line(ours, our_hand, mm_per_px)}")
    print(f"  Cycles    {contrast_line(truth, true_hand, mm_per_px)}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--shot", type=Path, default=Path(__file__).with_name("grasp.blend"))
    parser.add_argument("--frames", type=int, nargs="+", default=[12])
    parser.add_argument("--samples", type=int, default=64)
    parser.add_argument("--avatar", type=Path, help="in place of the shot's own")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    livehand.register()
    try:
        for frame in args.frames:
            compare(args, frame)
    finally:
        livehand.unregister()


if __name__ == "__main__":
    main()
