"""Make `wave.blend`: one second of a right hand that opens, pinches, points and makes a fist.

Run it with the Python that LiveHand is installed in: `python examples/make_wave.py [OUT.blend]`.

World: Z up, metres. The hand is upright with its back to the front (-Y) and its thumb to the left (-X), towards the
key lamp of the studio lights.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import bpy
import numpy as np
from example_file import write_example
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.model import MANO_FINGERS, UPRIGHT
from livehand.backend.hand.model_file import load_default_hand
from livehand.livehand_blender.light.studio import add_studio
from livehand.livehand_blender.rig.hand import RiggedHand
from livehand.livehand_blender.rig.keyframes import keyframe_theta, keyframe_transl

FRAMES = range(1, 25)
FPS = 24
SIZE_PX = (334, 512)


@dataclass(frozen=True)
class Key:
    """A key pose; between two of them every finger eases from one gesture to the next.

    Attributes:
        frame: when it is reached.
        gesture: a name in `GESTURES`.
        wrist_deg: rotation of the upright hand about X (forwards), Y (sideways) and Z (twist).
    """

    frame: float
    gesture: str
    wrist_deg: tuple[float, float, float]


MOTION = (
    Key(1, "open", (5, -4, -6)),
    Key(8, "pinch", (-5, 4, 14)),
    Key(15, "point", (5, 3, 10)),
    Key(22.3, "fist", (-4, 1, 24)),
)
# The library's fist, closed more tightly, with a thumb that lies on the other fingers.
CLOSED_FIST = replace(
    GESTURES["fist"],
    flexion={"index": (80, 98, 58), "middle": (82, 97, 58), "ring": (83, 95, 57), "pinky": (82, 92, 56)},
    thumb=((33, -16, 8), (42, 0, 0), (50, 0, 0)),
)
EASED_GESTURES = GESTURES | {"fist": CLOSED_FIST}
# The forearm turns by this share of the wrist's rotation; the wrist bends by the rest.
FOREARM_SHARE = 0.4
# Delay of each finger relative to the wrist: hands close from the little finger, and the thumb is last.
DELAY_FRAMES = {"pinky": -0.4, "ring": 0.0, "middle": 0.2, "index": 0.4, "thumb": 1.6}

HAIR = 0.5  # of a person's, on arm and fingers
FIELD_OF_VIEW_M = 0.272  # height of the image, 0.75 m away


@dataclass(frozen=True)
class CameraKey:
    """A key of the camera's arm.

    Attributes:
        frame: when.
        target_m: the point that the camera looks at and turns about.
        distance_m: from there.
        yaw_deg: about Z, from the front (0) towards the thumb's side (negative).
        pitch_deg: from above.
    """

    frame: int
    target_m: tuple[float, float, float]
    distance_m: float
    yaw_deg: float
    pitch_deg: float


CAMERA_MOVE = (
    CameraKey(1, (-0.020, 0.0, -0.027), 0.77, -16, 3),
    CameraKey(15, (-0.017, 0.0, -0.036), 0.75, -29, 6),
    CameraKey(24, (-0.012, 0.0, -0.052), 0.69, -40, 11),
)


def build_wave() -> bpy.types.Scene:
    """Fill the open, empty file with the hand, its motion and the camera."""
    scene = bpy.context.scene
    scene.name = "Wave"
    scene.frame_start, scene.frame_end, scene.render.fps = FRAMES[0], FRAMES[-1], FPS
    scene.render.resolution_x, scene.render.resolution_y = SIZE_PX
    scene.render.filepath = "//out/wave_"
    scene.render.image_settings.file_format = "PNG"
    bpy.ops.livehand.set_engine()
    bpy.ops.livehand.add_hand(side="right")
    armature = bpy.context.active_object
    armature.rotation_euler = (0, 0, 0)  # the keyed wrist makes the hand upright
    armature.livehand.hair = HAIR
    animate_hand(armature)
    add_camera(scene)
    scene.frame_set(FRAMES[0])
    add_studio(bpy.context)
    return scene


def animate_hand(armature: bpy.types.Object) -> None:
    """Key every bone on every frame, and the place of the wrist so that the knuckles start at the world's origin."""
    joints = load_default_hand().joints
    axes = FingerAxes.of_default_hand()
    wrists = np.array([wrist_rotation(frame) for frame in FRAMES])
    arms = np.array([wrist_rotation(frame, FOREARM_SHARE) for frame in FRAMES])
    roots = matrix_to_axis_angle(wrists)
    thetas = [theta_of(finger_angles_deg(frame), axes, root) for frame, root in zip(FRAMES, roots, strict=True)]
    knuckles = joints[0] + UPRIGHT @ (joints[4] - joints[0])
    hand = RiggedHand.of(armature)
    keyframe_theta(hand, np.array(thetas), FRAMES, forearms=matrix_to_axis_angle(wrists.swapaxes(1, 2) @ arms))
    keyframe_transl(hand, np.tile(-knuckles, (len(FRAMES), 1)), FRAMES)


def finger_angles_deg(frame: float) -> np.ndarray:
    """[15, 3] flexion, abduction and twist of joints 1..15, with each finger's own delay."""
    angles = np.empty((15, 3))
    gestures = np.array([EASED_GESTURES[key.gesture].angles_deg() for key in MOTION])
    for finger, name in enumerate(MANO_FINGERS):
        joints = slice(3 * finger, 3 * finger + 3)
        angles[joints] = eased(frame - DELAY_FRAMES[name], gestures[:, joints])
    return angles


def wrist_rotation(frame: float, share: float = 1.0) -> np.ndarray:
    """[3, 3] from the template to the world, by this share of the keys' angles."""
    nod, lean, screw = share * np.deg2rad(eased(frame, np.array([key.wrist_deg for key in MOTION])))
    x, y, z = np.eye(3)
    return axis_angle_to_matrix(screw * z) @ axis_angle_to_matrix(lean * y) @ axis_angle_to_matrix(nod * x) @ UPRIGHT


def eased(frame: float, values: np.ndarray) -> np.ndarray:
    """Between the values at `MOTION`'s keys, starting and stopping gently (minimum jerk)."""
    times = [key.frame for key in MOTION]
    after = int(np.clip(np.searchsorted(times, frame), 1, len(times) - 1))
    share = np.clip((frame - times[after - 1]) / (times[after] - times[after - 1]), 0, 1)
    share = share**3 * (10 - 15 * share + 6 * share**2)
    return (1 - share) * values[after - 1] + share * values[after]


def add_camera(scene: bpy.types.Scene) -> None:
    """A camera on an arm that turns slowly about the hand."""
    pivot = bpy.data.objects.new("Camera Pivot", None)
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    for thing in (pivot, camera):
        scene.collection.objects.link(thing)
    scene.camera = camera
    pivot.empty_display_size = 0.02
    camera.parent = pivot
    camera.rotation_euler = (np.pi / 2, 0, 0)
    camera.data.sensor_fit, camera.data.sensor_height = "VERTICAL", 24
    camera.data.lens = 24 * 0.75 / FIELD_OF_VIEW_M
    camera.data.clip_start, camera.data.clip_end = 0.01, 10
    camera.data.display_size = 0.05
    for key in CAMERA_MOVE:
        pivot.location = key.target_m
        pivot.rotation_euler = np.deg2rad((-key.pitch_deg, 0, key.yaw_deg))
        camera.location = (0, -key.distance_m, 0)
        for thing, channel in ((pivot, "location"), (pivot, "rotation_euler"), (camera, "location")):
            thing.keyframe_insert(channel, frame=key.frame)


if __name__ == "__main__":
    write_example(build_wave, Path(__file__).with_name("wave.blend"))
