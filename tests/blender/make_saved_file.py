"""Make `saved_by_0_2.blend`: a hand with every setting away from its default, as version 0.2 saves it.

Files of 0.2 stay readable: never make this file again, make another beside it when the settings change.
`python tests/blender/make_saved_file.py [OUT.blend]`.
"""

import sys
from pathlib import Path

import bpy

HAND = {
    "mesh_selectable": True,
    "skin": "middle",
    "exposure": 0.5,
    "gain": (1.25, 1.0, 0.75),
    "bias": (0.0, 0.125, 0.0),
    "wrist_fade": 20.0,
    "hair": 0.25,
}
SCENE = {
    "mode": "SCENE",
    "light": "CAPTURE",
    "skin_detail": False,
    "blur_samples": 7,
    "free_after_render": False,
    "device": "cpu",
    "precision": "bf16",
    "keep_look": True,
}
LAYER = {"use_pass_hand": True, "use_pass_fade": True}
SLIDERS = {"ring.ik": 0.25, "thumb.spread": -0.5, "limit_joints": True, "follow": 0.5, "fist": 0.125}
BETA = [0.5, -1.0, *[0.0] * 8]
KEYED = {1: 0.0, 11: 0.75}
"""Frame -> *Curl* of the index finger."""


def build():
    """Fill an empty file."""
    from livehand.backend.hand.model_file import load_default_hand
    from livehand.livehand_blender.rig.build import add_hand
    from livehand.livehand_blender.rig.sliders import slider_path, write_slider
    from livehand.livehand_blender.scene.settings import use_livehand

    scene = bpy.context.scene
    hand = add_hand(bpy.context, load_default_hand())
    for group, values in ((hand.livehand, HAND), (scene.livehand, SCENE), (scene.view_layers[0].livehand, LAYER)):
        for name, value in values.items():
            setattr(group, name, value)
    for name, value in (SLIDERS | {"beta": BETA}).items():
        write_slider(hand, name, value)
    for frame, value in KEYED.items():
        write_slider(hand, "index.curl", value)
        hand.keyframe_insert(slider_path("index.curl"), frame=frame)
    scene["livehand"]["rough_light"] = 1  # a setting that 0.2 no longer has
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location = (-0.08, 0, 0.5)
    scene.collection.objects.link(scene.camera)
    use_livehand(scene)
    scene.render.resolution_x, scene.render.resolution_y = 48, 64


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2] / "examples"))
    from example_file import write_example

    write_example(build, Path(__file__).with_name("saved_by_0_2.blend"))
