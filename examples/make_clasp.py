"""Make `clasp.blend`: two clasped hands, light and deep, whose fingers occlude each other.

Run it with the Python that LiveHand is installed in: `python examples/make_clasp.py [OUT.blend]`.
"""

from pathlib import Path

import bpy
import numpy as np
from example_file import write_example
from livehand.backend.hand.gestures import FingerAxes, Gesture, theta_of
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE
from livehand.livehand_blender.light.studio import add_studio
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.pose import write_theta
from mathutils import Matrix
from photo_set import add_camera

SIZE_PX = (640, 512)
CURL = Gesture(
    {"index": (30, 46, 24), "middle": (40, 48, 25), "ring": (42, 48, 25), "pinky": (42, 48, 25)},
    {"index": 6, "pinky": -3},
    ((12, 6, 10), (22, 0, 0), (14, 0, 0)),
)
TILT_DEG, APART_M = 42, 0.0175  # of each hand, from the plane between their palms
CAMERA_M, TARGET_M, LENS_MM = (-0.28, -0.52, 0.22), (0.03, 0.0, 0.0), 85


def build_clasp() -> bpy.types.Scene:
    """Fill the open, empty file with two crossed hands, palm to palm, camera and studio lights."""
    scene = bpy.context.scene
    scene.name = "Clasp"
    scene.frame_start = scene.frame_end = 1
    scene.render.resolution_x, scene.render.resolution_y = SIZE_PX
    bpy.ops.livehand.set_engine()
    tilt = Matrix.Rotation(np.deg2rad(TILT_DEG), 4, "Y")
    about = Matrix.Rotation(np.pi, 4, "Z")
    add_hand("right", "light", Matrix.Translation((0, APART_M, 0)) @ tilt)
    add_hand("left", "deep", Matrix.Translation((0, -APART_M, 0)) @ tilt.inverted() @ about)
    add_camera(scene, CAMERA_M, TARGET_M, LENS_MM)
    add_studio(bpy.context)
    return scene


def add_hand(side: str, skin: str, place: Matrix) -> None:
    """A curled hand at a place."""
    bpy.ops.livehand.add_hand(side=side)
    armature = bpy.context.active_object
    armature.livehand.skin = skin
    armature.matrix_world = place
    theta = theta_of(CURL.angles_deg(), FingerAxes.of_default_hand())
    write_theta(RiggedHand.of(armature), theta if side == "right" else theta * MIRROR_AXIS_ANGLE)


if __name__ == "__main__":
    write_example(build_clasp, Path(__file__).with_name("clasp.blend"))
