"""Learns what the tracker's landmarks say of our joints, on made pictures of our own hand, and measures the fit.

    python examples/learn_landmarks.py sights out/sights_1.npz --count 8000 --seed 1  # pictures, tracked: 0.15 s each
    python examples/learn_landmarks.py train out/sights_*.npz                         # backend's mediapipe_lifting.npz
    python examples/learn_landmarks.py gates --takes 12 --seed 4242                   # measures takes made anew

Needs the tracker's networks (`livehand fetch-tracker`).
"""

import argparse
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np
import torch
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.geometry.rotation import axis_angle_to_matrix, matrix_to_axis_angle
from livehand.backend.hand.gestures import FingerAxes, sample_angles_deg, theta_of
from livehand.backend.hand.joint_limits import FREE
from livehand.backend.hand.lbs import posed_vertices
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.hand.poses import POSES
from livehand.backend.image.decode import straight_srgb
from livehand.backend.motion.landmarks import lifting
from livehand.backend.motion.landmarks.camera_fit import at_nodes
from livehand.backend.motion.landmarks.lifting import CanonicalView
from livehand.backend.motion.landmarks.skeleton import landmarks_of
from livehand.backend.motion.landmarks.take_fit import FilmCamera, FilmedHand, fit_take
from livehand.backend.motion.spaces import rest_wrists
from livehand.backend.records.camera import Camera
from livehand.backend.records.light import Lamp, Light, Sky, rotation_facing
from livehand.backend.records.shot import HandPose, Shot
from livehand.backend.render.renderer import Renderer
from livehand.backend.research.pose_errors import PoseErrors, pose_errors
from livehand.backend.research.takes import made_take, pictures, single_fingers_deg
from livehand.backend.tracking.crop import region_of_landmarks
from livehand.backend.tracking.tracker import HandTracker
from livehand.backend.tracking.weights import load_networks
from torch import nn

HAND = load_default_hand()
AVATARS = ("light", "middle", "deep")
VIEWS = ("palm", "back", "side")
SIZE_PX, PALM_TO_CAMERA = (640, 480), np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
LIBRARY = np.stack([pose.gesture.angles_deg() for pose in POSES.values()])
WIDTH, STEPS, BATCH, INPUT_NOISE, DROPOUT = 256, 12000, 256, 0.03, 0.1
LIFTING_FILE = Path(lifting.__file__).with_name("mediapipe_lifting.npz")


@dataclass(frozen=True)
class Sight:
    """What the tracker saw, px [21, 2] and world [21, 3] m; the truth, joints [21, 3] m and free angles [21] rad."""

    px: np.ndarray
    world: np.ndarray
    focal_px: float
    joints: np.ndarray
    free: np.ndarray


class SightMaker:
    """Random hands: fingers by themselves, between poses of the library, mixes; from everywhere, in any light."""

    def __init__(self, seed: int):
        self._rng = np.random.default_rng(seed)
        self._renderers = [Renderer(load_avatar(shipped_avatar_path(name)), HAND, "cpu") for name in AVATARS]
        self._tracker, self._axes = HandTracker(load_networks(), 1), FingerAxes.of_default_hand()

    def sight(self) -> Sight | None:
        """The next one; None where the hand leaves the picture or is not found."""
        rng, angles = self._rng, self._angles_deg()
        pose, focal_px = self._pose(angles)
        joints = landmarks_of(HAND, pose)
        px = joints[:, :2] / joints[:, 2:] * focal_px + np.array(SIZE_PX) / 2
        if ((px > -10) & (px < np.array(SIZE_PX) + 10)).all(1).mean() < 0.85:
            return None
        K = np.array([[focal_px, 0, SIZE_PX[0] / 2], [0, focal_px, SIZE_PX[1] / 2], [0, 0, 1]])
        picture = self._picture(pose, Camera(K, np.eye(4), SIZE_PX))
        region = region_of_landmarks(px + rng.normal(0, 4, px.shape))
        for _ in range(2):  # as a hand that is followed is seen
            hand = self._tracker.look(picture, region)
            region = region_of_landmarks(hand.px)
        if hand.presence < 0.5:
            return None
        return Sight(hand.px, hand.world, focal_px, joints, np.deg2rad(angles.reshape(45)[FREE]))

    def _angles_deg(self) -> np.ndarray:
        rng, kind = self._rng, self._rng.random()
        if kind < 0.25:
            return single_fingers_deg(rng)
        if kind < 0.59:
            first, second = rng.choice(len(LIBRARY), 2, replace=False)
            share = rng.beta(0.6, 0.6)
            angles = (1 - share) * LIBRARY[first] + share * LIBRARY[second]
            return self._noisy(angles) if rng.random() < 0.5 else angles
        if kind < 0.89:
            return sample_angles_deg(rng, 1)[0]
        angles = LIBRARY[rng.integers(len(LIBRARY))].copy()
        for finger in range(5):
            joints = slice(3 * finger, 3 * finger + 3)
            own, share = LIBRARY[rng.integers(len(LIBRARY))][joints], rng.beta(0.6, 1.2)
            angles[joints] = (1 - share) * angles[joints] + share * own
        return self._noisy(angles)

    def _noisy(self, angles: np.ndarray) -> np.ndarray:
        angles = angles.copy()
        angles[:, 0] += self._rng.normal(0, 4, 15)
        angles[::3, 1] += self._rng.normal(0, 3, 5)
        return angles

    def _pose(self, angles_deg: np.ndarray) -> tuple[HandPose, float]:
        """And the focal length, px."""
        rng, theta = self._rng, theta_of(angles_deg, self._axes)
        yaw, tilt, roll = rng.uniform(0, 360), np.clip(rng.normal(0, 25), -70, 70), rng.uniform(-60, 60)
        x, y, z = (axis_angle_to_matrix(np.deg2rad(turn) * np.eye(3)[k]) for k, turn in enumerate((tilt, yaw, roll)))
        root = z @ x @ y @ PALM_TO_CAMERA
        theta[0] = matrix_to_axis_angle(root[None])[0]
        beta, focal_px = rng.normal(0, 0.7, 10), rng.uniform(480, 800)
        depth = rng.uniform(0.34, 0.62) * focal_px / 620
        middle = np.array([*(rng.uniform(-0.25, 0.25) * depth * side / focal_px for side in SIZE_PX), depth])
        wrist = middle - 0.09 * (root @ [-1.0, 0, 0])
        return HandPose(theta, beta, wrist - rest_wrists(HAND.for_side("right"), beta), "right"), focal_px

    def _picture(self, pose: HandPose, camera: Camera) -> np.ndarray:
        rng = self._rng
        renderer = self._renderers[rng.integers(len(AVATARS))]
        rgba = straight_srgb(renderer.render(Shot(pose, posed_vertices(HAND, pose), camera, self._light())))
        grey = rng.uniform(0.1, 0.8, 3) * 0.4 + rng.uniform(0.1, 0.8) * 0.6
        across, down = np.linspace(-1, 1, SIZE_PX[0])[:, None], np.linspace(-1, 1, SIZE_PX[1])[:, None, None]
        ground = grey + across * rng.normal(0, 0.08) + down * rng.normal(0, 0.08)
        shown = rgba[..., :3] * rgba[..., 3:] + ground * (1 - rgba[..., 3:])
        shown = shown + rng.normal(0, rng.uniform(0, 0.02), shown.shape)
        return (np.clip(shown, 0, 1) * 255).round().astype(np.uint8)

    def _light(self) -> Light:
        rng = self._rng
        sky = Sky(rng.uniform(0.3, 1.1) * np.exp(rng.normal(0, 0.35, (2, 4, 1)) + rng.normal(0, 0.06, (2, 4, 3))))
        if rng.random() >= 0.5:
            return Light((), sky)
        towards = rng.normal(size=3)
        towards[2] = -abs(towards[2])
        rotation = rotation_facing(towards / np.linalg.norm(towards))
        return Light((Lamp("sun", np.ones(3) * rng.uniform(0.5, 3), rotation=rotation, angle_rad=0.05),), sky)


def make_sights(path: Path, count: int, seed: int) -> None:
    maker, found = SightMaker(seed), []
    while len(found) < count:
        sight = maker.sight()
        if sight is None:
            continue
        found.append(sight)
        if len(found) % 500 == 0 or len(found) == count:
            columns = zip(*map(astuple, found), strict=True)
            np.savez(
                path, **{field.name: np.stack(column) for field, column in zip(fields(Sight), columns, strict=True)}
            )
            print(len(found), flush=True)


def inputs_and_targets(path: Path) -> tuple[np.ndarray, np.ndarray]:
    """Features [N, 105]; [N, 63] where the joints are seen beside their landmarks, in the hand's view, and angles."""
    with np.load(path) as sights:
        focal_px = sights["focal_px"][:, None, None]
        points, world = at_nodes((sights["px"] - np.array(SIZE_PX) / 2) / focal_px), at_nodes(sights["world"])
        joints, free = at_nodes(sights["joints"]), sights["free"]
    view = CanonicalView.of(points)
    off = view.shown(joints[..., :2] / joints[..., 2:]) - view.shown(points)
    return view.features(points, world), np.concatenate([off.reshape(len(off), -1), free], 1)


def train(paths: list[Path], held_out: int = 1000) -> None:
    """A Gaussian likelihood, each weighted by its deviation, so that the sure are not learnt at the others' cost."""
    torch.manual_seed(0)
    given, wanted = (np.concatenate(columns) for columns in zip(*map(inputs_and_targets, paths), strict=True))
    order = np.random.default_rng(0).permutation(len(given))  # held out are some of every file
    given, wanted = given[order], wanted[order]
    centre, spread, mean, deviation = given.mean(0), given.std(0) + 1e-3, wanted.mean(0), wanted.std(0) + 1e-4
    x, y = (torch.from_numpy(part).float() for part in ((given - centre) / spread, (wanted - mean) / deviation))
    layers = [nn.Linear(x.shape[1], WIDTH), nn.Linear(WIDTH, WIDTH), nn.Linear(WIDTH, WIDTH)]
    last = nn.Linear(WIDTH, 2 * y.shape[1])
    net = nn.Sequential(*(part for layer in layers for part in (layer, nn.SiLU(), nn.Dropout(DROPOUT))), last)
    optimiser = torch.optim.AdamW(net.parameters(), 2e-3, weight_decay=1e-2)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, STEPS)
    for step in range(1, STEPS + 1):
        some = torch.randint(len(x) - held_out, (BATCH,))
        means, logs = net(x[some] + INPUT_NOISE * torch.randn(BATCH, x.shape[1])).chunk(2, -1)
        logs = logs.clamp(-5, 2)
        loss = (((means - y[some]) ** 2 * (-2 * logs).exp() + 2 * logs) * logs.detach().exp()).mean()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        schedule.step()
        if step % (STEPS // 5) == 0:
            net.eval()
            with torch.no_grad():
                off = (net(x[-held_out:]).chunk(2, -1)[0] - y[-held_out:]).numpy() * deviation
            net.train()
            points, raw = (np.linalg.norm(part[:, :42].reshape(-1, 21, 2), axis=-1).mean() for part in (off, wanted))
            angles = np.rad2deg(np.abs(off[:, 42:])).mean()
            print(
                f"{step}: joints off by {points:.3f} of the hand's radius ({raw:.3f} before), angles {angles:.2f} deg"
            )
    scale = np.concatenate([deviation, deviation])
    arrays = {"centre": centre, "spread": spread, "usual_mean": mean[42:], "usual_sd": deviation[42:]}
    for number, layer in enumerate((*layers, last)):
        weight, bias = layer.weight.detach().numpy(), layer.bias.detach().numpy()
        if layer is last:
            weight, bias = weight * scale[:, None], bias * scale
            half = len(mean)
            weight[half:], bias[half:] = weight[half:] / deviation[:, None], bias[half:] / deviation + np.log(deviation)
            bias[:half] += mean
        arrays |= {f"weight{number}": weight, f"bias{number}": bias}
    np.savez_compressed(LIFTING_FILE, **{name: array.astype(np.float16) for name, array in arrays.items()})


def tracked_takes(count, seed, kinds=("library", "mixes")):
    """Yields (take, what was seen of it): of these kinds of poses in turn, from all sides."""
    rng, networks = np.random.default_rng(seed), load_networks()
    renderer = Renderer(load_avatar(shipped_avatar_path("light")), HAND, "cpu")
    for index in range(count):
        take = made_take(rng, HAND, kinds[index % len(kinds)], VIEWS[index // len(kinds) % 3])
        tracker = HandTracker(networks, 1)
        found = [tracker.track(picture) for picture in pictures(take, renderer, rng)]
        frames = np.array([frame for frame, hands in enumerate(found) if hands])
        px, world = (np.stack([getattr(found[frame][0], name) for frame in frames]) for name in ("px", "world"))
        yield take, FilmedHand(frames, px, world)


def measure(takes):
    rows = []
    for take, seen in takes:
        camera = FilmCamera(take.camera.size_px, take.camera.K[0, 0])
        fit = fit_take(seen, np.arange(len(take.motion)) / 30, camera, HAND, "right", 30.0)
        kept = slice(seen.frames[0], seen.frames[-1] + 1)
        found = [fit.motion.pose(index) for index in range(len(fit.motion))]
        rows.append(pose_errors(HAND, found, [take.motion.pose(index) for index in range(len(take.motion))][kept]))
        print(rows[-1], flush=True)
    print("mean:", PoseErrors(*np.mean(rows, 0)))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    making = commands.add_parser("sights", help="make and track pictures")
    making.add_argument("output", type=Path)
    making.add_argument("--count", type=int, default=8000)
    training = commands.add_parser("train", help="train the lifting on them")
    training.add_argument("sights", type=Path, nargs="+")
    gates = commands.add_parser("gates", help="measure the fit on takes made anew")
    gates.add_argument("--takes", type=int, default=12)
    gates.add_argument("--kinds", nargs="+", choices=("library", "mixes", "single"), default=("library", "mixes"))
    for command in (making, gates):
        command.add_argument("--seed", type=int, default=100)
    args = parser.parse_args()
    if args.command == "sights":
        make_sights(args.output, args.count, args.seed)
    elif args.command == "train":
        train(args.sights)
    else:
        measure(tracked_takes(args.takes, args.seed, args.kinds))
