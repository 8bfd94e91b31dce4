"""Render held-out views of a capture in varied lights through Blender, *Hand in Scene*, beside the truth.

    python examples/captured_lights.py CAPTURE AVATAR OUT_DIR [--kind block] [--split test]

Cycles measures the light on the bare hand, with what coloured walls reflect, which `livehand evaluate` cannot know. For
every view it writes FILE.png (truth left, LiveHand right) and prints the PSNR on the hand's pixels.
"""

import argparse
from pathlib import Path

import bpy
import livehand
import numpy as np
import torch
from livehand.backend.capture.capture import Capture, CaptureView, load_capture
from livehand.backend.capture.picture import read_linear_picture
from livehand.backend.evaluation.exposure import exposed, exposure_gain
from livehand.backend.evaluation.metrics import psnr_db
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.capture.lighting import SceneLighting
from livehand.livehand_blender.capture.scene import capture_scene, set_camera
from livehand.livehand_blender.rig.build import add_hand
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import write_hand_pose
from PIL import Image


def hand_scene(avatar: Path) -> bpy.types.Scene:
    """The scene of a capture, with a hand that LiveHand renders."""
    scene = capture_scene()
    armature = add_hand(bpy.context, load_default_hand())
    armature.livehand.avatar_path = str(avatar.resolve())
    scene.render.engine, scene.livehand.mode, scene.cycles.samples = "LIVEHAND", "SCENE", 4
    scene.render.image_settings.file_format, scene.render.image_settings.color_depth = "OPEN_EXR", "32"
    return scene


def render_view(scene: bpy.types.Scene, lighting: SceneLighting, capture: Capture, view: CaptureView, path: Path):
    """[H, W, 4] linear, premultiplied."""
    (hand,) = RiggedHand.all_in(scene)
    write_hand_pose(hand, capture.poses[view.pose_index])
    lighting.set_lights([capture.lights[view.light]], [""])
    set_camera(scene, view.camera)
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)
    return read_linear_picture(path, view.camera.size_px, False)


def compare(args: argparse.Namespace) -> None:
    """Render and measure the views one by one."""
    capture = load_capture(args.capture)
    of_split = [view for view in capture.of_split(args.split) if view.light is not None]
    chosen = [view for view in of_split if capture.lights[view.light].kind == args.kind]
    if not chosen:
        raise SystemExit(f"{args.capture} must have {args.split} images in {args.kind} light, got none")
    scene = hand_scene(args.avatar)
    lighting = SceneLighting(scene)
    figures = []
    for view in chosen:
        truth = capture.read_linear(view)
        image = render_view(scene, lighting, capture, view, args.folder / "render.exr")
        gain = exposure_gain(truth)
        truth, image = exposed(truth, gain), exposed(image, gain)
        name = Path(view.file).stem
        both = np.hstack([truth, image])[..., :3]
        Image.fromarray((both.clip(0, 1) * 255 + 0.5).astype(np.uint8)).save(args.folder / f"{name}.png")
        pair = (torch.as_tensor(pixels[..., :3]) for pixels in (image, truth))
        figures.append(psnr_db(*pair, torch.as_tensor(truth[..., 3] > 0.5)))
        print(f"{name}: {figures[-1]:.2f} dB on the hand")
    print(f"{args.kind}: {np.mean(figures):.2f} dB on the hand, mean of {len(figures)} views")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("capture", type=Path)
    parser.add_argument("avatar", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kind", default="block")
    parser.add_argument("--split", default="test")
    args = parser.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    livehand.register()
    try:
        compare(args)
    finally:
        livehand.unregister()


if __name__ == "__main__":
    main()
