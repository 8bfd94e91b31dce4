"""How far a phone carries: a made film of a turning hand with its truth, and captures that are compared with it.

    python examples/phone_video.py film out/phone.mp4 out/truth.npz             # 20 s of another hand; 2 minutes
    livehand track out/phone.mp4 -o out/take.npz --capture out/phone
    python examples/phone_video.py true out/phone out/truth.npz out/phone_true  # the same pictures, the true poses
    python examples/phone_video.py rig out/phone out/rig                         # the same hand from six cameras
    livehand train out/phone -o out/own.safetensors --refine --steps 1500 --perceptual 0 \\
        --from light
    livehand evaluate out/own.refined --avatar out/own.safetensors --split novel_pose
    python examples/phone_video.py compare out/phone_true out/phone out/own.refined

The film is rendered by an avatar that ships, in a random shape, in a lamp's light, before a wall. The wrist bends,
and the masks of captures end there. `film` needs PyAV.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.capture.capture import Capture, CaptureView, load_capture, save_capture_index
from livehand.backend.capture.masks.mask import MaskConfig
from livehand.backend.capture.masks.mask_capture import mask_capture
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import FingerAxes, sample_angles_deg, theta_of
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.poses import POSES
from livehand.backend.image.decode import straight_srgb
from livehand.backend.motion.motion import HandMotion
from livehand.backend.motion.spaces import TO_BLENDER, rest_wrists, transformed
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.render.studio_light import studio_light
from livehand.backend.research.pose_errors import pose_errors
from livehand.backend.tracking.video_writer import write_video
from livehand.backend.training.refined_capture import save_by_reference
from PIL import Image

SIZE_PX, FOCAL_PX, FPS, SECONDS = (640, 480), 620.0, 15.0, 20.0
DISTANCE_M, SHAPE_SPREAD, WRIST_DEG, NOISE = 0.45, 0.7, 8.0, 0.008
KEY_EVERY_S, OPENNESS = 3.0, 0.6
UPRIGHT = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # in a camera's axes: fingers up, palm towards it
INSTANTS, CAMERAS = 18, 6  # as many images as the film gives
SEED = 5


def made_motion(rng: np.random.Generator) -> HandMotion:
    """In Blender's world: from palm to back and on, and back again, leaning to and fro; the fingers bend a little."""
    hand, axes, t = load_default_hand(), FingerAxes.of_default_hand(), np.arange(round(FPS * SECONDS)) / FPS
    keys = sample_angles_deg(rng, int(SECONDS / KEY_EVERY_S) + 2)
    keys = OPENNESS * POSES["Five"].gesture.angles_deg() + (1 - OPENNESS) * keys
    key, share = (t / KEY_EVERY_S).astype(int), ((t / KEY_EVERY_S) % 1)[:, None, None]
    share = share * share * (3 - 2 * share)
    theta = np.stack([theta_of(each, axes) for each in (1 - share) * keys[key] + share * keys[key + 1]])
    yaw = 90 - 130 * np.cos(2 * np.pi * t / SECONDS)
    lean, roll = 25 * np.sin(2 * np.pi * t / 4.3), 15 * np.sin(2 * np.pi * t / 6.1 + 1)
    x, y, z = (
        axis_angle_to_matrix(np.deg2rad(turn)[:, None] * np.eye(3)[k]) for k, turn in enumerate((lean, yaw, roll))
    )
    root = TO_BLENDER["opencv"] @ z @ x @ y @ UPRIGHT
    theta[:, 0] = matrix_to_axis_angle(root)
    beta = rng.normal(0, SHAPE_SPREAD, 10)
    sway = 0.015 * np.stack([np.sin(2 * np.pi * t / 5.2), np.sin(2 * np.pi * t / 3.7), np.sin(2 * np.pi * t / 7)], 1)
    wrist = np.array([0, 0, 0.01]) + sway - 0.09 * (root @ [-1.0, 0, 0])
    forearm = np.deg2rad(WRIST_DEG) * np.stack([0 * t, np.sin(2 * np.pi * t / 5.7), np.cos(2 * np.pi * t / 4.9)], 1)
    return HandMotion(theta, beta, wrist - rest_wrists(hand, beta), FPS, "right", forearm)


def camera() -> Camera:
    """Before the hand, which is about the origin."""
    cam2world = np.eye(4)
    cam2world[:3, :3], cam2world[:3, 3] = TO_BLENDER["opencv"], [0, -DISTANCE_M, 0]
    K = np.array([[FOCAL_PX, 0, SIZE_PX[0] / 2], [0, FOCAL_PX, SIZE_PX[1] / 2], [0, 0, 1]])
    return Camera(K, cam2world, SIZE_PX)


def wall(rng: np.random.Generator) -> np.ndarray:
    """[H, W, 3] a rough wall with a shelf, still."""
    width, height = SIZE_PX
    rows, columns = np.mgrid[:height, :width] / height
    rough = np.zeros((height, width))
    for cells in (4, 9, 20, 60):
        coarse = rng.normal(size=(cells, cells))
        at = [(axis / axis.max() * (cells - 1)).astype(int) for axis in (rows, columns)]
        rough += coarse[at[0], at[1]] / cells**0.5
    ground = np.array([0.36, 0.44, 0.47]) + 0.12 * (columns - 0.6)[..., None] + 0.012 * rough[..., None]
    ground[(rows > 0.8) & (rows < 0.84)] = (0.28, 0.22, 0.2)
    return ground


def film(args: argparse.Namespace) -> None:
    rng = np.random.default_rng(SEED)
    motion, ground = made_motion(rng), wall(rng)
    renderer = Renderer(load_avatar(shipped_avatar_path(args.person)), load_default_hand(), "cpu")
    write_video(_pictures(motion, ground, renderer, rng), args.video, np.arange(len(motion)) / FPS, FPS)
    arrays = {"theta": motion.theta, "beta": motion.beta, "transl": motion.transl}
    np.savez(args.truth, **arrays, cam2world=camera().cam2world)
    print(f"{args.video}: {len(motion)} frames")


def _pictures(motion: HandMotion, ground: np.ndarray, renderer: Renderer, rng) -> Iterator[np.ndarray]:
    for index in range(len(motion)):
        if index % 30 == 0:
            print(index, flush=True)
        yield _picture(motion.pose(index), camera(), ground, renderer, rng)


def _picture(pose: HandPose, camera: Camera, ground: np.ndarray, renderer: Renderer, rng) -> np.ndarray:
    rgba = straight_srgb(renderer.render(Shot(pose, posed_vertices(renderer.hand, pose), camera, studio_light())))
    shown = rgba[..., :3] * rgba[..., 3:] + ground * (1 - rgba[..., 3:]) + rng.normal(0, NOISE, ground.shape)
    return (np.clip(shown, 0, 1) * 255).round().astype(np.uint8)


def true_capture(args: argparse.Namespace) -> None:
    """The images and masks of a capture with the true poses, shape and focal length."""
    capture = load_capture(args.capture)
    hand = load_default_hand()
    with np.load(args.truth) as truth:
        arrays = {name: truth[name][capture.provenance["frames"]] for name in ("theta", "transl")}
        motion, cam2world = HandMotion(arrays["theta"], truth["beta"], arrays["transl"], FPS), truth["cam2world"]
    to_capture = capture.views[0].camera.cam2world @ np.linalg.inv(cam2world)
    motion = transformed(motion, to_capture, rest_wrists(hand, motion.beta))
    share = FOCAL_PX / capture.provenance["focal_px"]
    views = tuple(replace(view, camera=_with_focal(view.camera, share)) for view in capture.views)
    poses = tuple(motion.pose(index) for index in range(len(motion)))
    save_by_reference(replace(capture, poses=poses, views=views), args.output)


def rig(args: argparse.Namespace) -> None:
    """A capture of the same hand in the same light: instants of the training part of the turn, from all sides."""
    capture = load_capture(args.capture)
    trained = [capture.provenance["frames"][view.pose_index] for view in capture.of_split("train")]
    frames = [trained[index] for index in np.linspace(0, len(trained) - 1, INSTANTS).round().astype(int)]
    rng = np.random.default_rng(SEED)
    motion, ground = made_motion(rng), wall(rng)
    renderer = Renderer(load_avatar(shipped_avatar_path(args.person)), load_default_hand(), "cpu")
    views = []
    (args.output / "images").mkdir(parents=True)
    for pose, frame in enumerate(frames):
        for number, camera in enumerate(_around()):
            views.append(CaptureView(f"images/{pose}_{number}.png", camera, number, pose, "train"))
            picture = _picture(motion.pose(frame), camera, ground, renderer, rng)
            Image.fromarray(picture).save(args.output / views[-1].file)
    hand = load_default_hand()
    poses = tuple(replace(motion.pose(frame), forearm=np.zeros(3)) for frame in frames)
    save_capture_index(Capture(args.output, hand.sha256, {"made_by": "phone_video"}, poses, tuple(views)))
    mask_capture(args.output, hand, MaskConfig(ends_at_wrist=True))


def _around() -> list[Camera]:
    """Cameras around the hand, in turn level and above it; the first is the film's."""
    turns = np.deg2rad(np.arange(CAMERAS) * 360 / CAMERAS)
    points = [[np.sin(turn), -np.cos(turn), 0.45 * (number % 2)] for number, turn in enumerate(turns)]
    up = np.array([0.0, 0, 1])
    return [
        replace(camera(), cam2world=look_at(DISTANCE_M * np.array(place) / np.linalg.norm(place), np.zeros(3), up))
        for place in points
    ]


def _with_focal(camera: Camera, share: float) -> Camera:
    K = camera.K.copy()
    K[[0, 1], [0, 1]] *= share
    return replace(camera, K=K)


def compare(args: argparse.Namespace) -> None:
    """Mean angle between joints' rotations, and of the tips from the wrist, of training and of held-out poses."""
    truth = load_capture(args.truth)
    for folder in args.captures:
        capture = load_capture(folder)
        for split in ("train", "novel_pose"):
            poses = sorted({view.pose_index for view in truth.of_split(split)})
            found, wanted = ([some.poses[index] for index in poses] for some in (capture, truth))
            print(f"{folder} {split}: {pose_errors(load_default_hand(), found, wanted)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(required=True)
    filming = commands.add_parser("film", help="render the film, and write its truth")
    filming.add_argument("video", type=Path)
    filming.add_argument("truth", type=Path)
    filming.add_argument("--person", default="middle")
    filming.set_defaults(run=film)
    making = commands.add_parser("true", help="write a capture's images with the true poses")
    making.add_argument("capture", type=Path)
    making.add_argument("truth", type=Path)
    making.add_argument("output", type=Path)
    making.set_defaults(run=true_capture)
    rigging = commands.add_parser("rig", help="write a multi-view capture of the same hand")
    rigging.add_argument("capture", type=Path)
    rigging.add_argument("output", type=Path)
    rigging.add_argument("--person", default="middle")
    rigging.set_defaults(run=rig)
    comparing = commands.add_parser("compare", help="print how far captures' poses are from the true ones")
    comparing.add_argument("truth", type=Path)
    comparing.add_argument("captures", type=Path, nargs="+")
    comparing.set_defaults(run=compare)
    args = parser.parse_args()
    args.run(args)
