"""What several test files share: posed hands, spheres, views, an exact search, a painted capture, a dead process."""

import hashlib
import runpy
import subprocess
import sys
from dataclasses import fields, is_dataclass, replace
from functools import cache
from importlib.util import find_spec
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
import trimesh
from livehand.backend.capture.capture import Capture, CaptureView, save_capture_index
from livehand.backend.capture.exr import write_exr
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.compute.cpu.backend import NumbaBackend
from livehand.backend.compute.reference import ReferenceBackend
from livehand.backend.field.conditions import FrameConditions
from livehand.backend.field.rays import camera_tensors
from livehand.backend.geometry.mesh import PosedMesh, Topology, face_neighbours, mean_edge_length, posed_mesh
from livehand.backend.geometry.rasterise import rasterise
from livehand.backend.hand.gestures import GESTURES, FingerAxes, theta_of
from livehand.backend.hand.lbs import SkinTensors, pose_hand, skin_motion
from livehand.backend.hand.model import MIRROR_AXIS_ANGLE, MIRROR_POINT
from livehand.backend.hand.model_file import load_default_hand, load_hand_model
from livehand.backend.hand.poses import POSES
from livehand.backend.hand.topology import Skinning, topology_of
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.light import Lamp, Light, Sky
from livehand.backend.records.shot import HandPose
from livehand.backend.surface.detail_maps import DetailMaps
from livehand.backend.surface.detail_mesh import DetailTemplate, detail_mesh
from livehand.backend.surface.detail_surface import load_detail_surface
from livehand.tools.builtin_hand import TEMPLATE
from PIL import Image


@pytest.fixture(scope="session", autouse=True)
def _detail_maps_are_made_once():
    """A person's, which every renderer of an avatar with a surface makes: they are most of its first frame's time."""
    made, make = {}, DetailMaps.of

    def once(detail, look, device="cpu"):
        key = digest_of(detail), look, str(device)
        if key not in made:
            made[key] = make(detail, look, device)
        return made[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(DetailMaps, "of", staticmethod(once))
        yield


@pytest.fixture(scope="session")
def signer(tmp_path_factory):
    """Paths of a certificate chain and of its private key, of a studio whom nobody else knows."""
    pytest.importorskip("cryptography")
    certificates = runpy.run_path(str(Path(__file__).parent / "certificates.py"))
    return certificates["write_signer"](tmp_path_factory.mktemp("pem"))


def digest_of(record):
    """The digest of all arrays in nested dataclasses."""
    if isinstance(record, np.ndarray):
        return f"{record.dtype} {record.shape}".encode() + hashlib.blake2b(np.ascontiguousarray(record)).digest()
    values = [getattr(record, one.name) for one in fields(record)] if is_dataclass(record) else tuple(record)
    return b"".join(digest_of(value) for value in values)


@pytest.fixture(scope="session")
def dead_pid():
    """The id of a process that has ended."""
    process = subprocess.Popen([sys.executable, "-c", ""])
    process.wait()
    return process.pid


SIZE = (24, 32)
SKY = Light(sky=Sky(np.full((4, 8, 3), 0.3)))
SUN = Light((Lamp("sun", np.array([3.0, 3, 3]), rotation=np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])),))  # along +Y
SLAB = np.array([[[-1.0, -0.3, -1], [1, -0.3, -1], [0, -0.3, 2]]])


def warp_backend():
    """On Warp's CPU device; imported when a test asks for it."""
    from livehand.backend.compute.gpu.backend import WarpBackend

    return WarpBackend()


# A new backend joins here, and every stage is tested with it.
FASTER = [NumbaBackend, *([warp_backend] if find_spec("warp") else [])]


class PosedHand(NamedTuple):
    """The built-in hand in a gesture: topology, skinning, mesh, and the pose mirrored to the avatar's (right) side."""

    topology: Topology
    skinning: Skinning
    mesh: PosedMesh
    theta: torch.Tensor

    def conditions(self):
        visibility = NumbaBackend().visibility(self.mesh, self.topology)
        return FrameConditions.of(self.theta, self.skinning, self.topology, self.mesh, visibility)


@pytest.fixture(scope="session")
def hand():
    """The built-in hand model, right side."""
    return load_default_hand()


@pytest.fixture(scope="session")
def hand_without_arm():
    """The built-in hand model that ends in a stump, right side."""
    return load_hand_model(TEMPLATE)


@pytest.fixture(scope="session")
def posed(hand):
    """A function (gesture or library pose, side="right") -> PosedHand; a left hand wears the right one's look."""
    return posed_hands(hand)


@pytest.fixture(scope="session")
def posed_without_arm(hand_without_arm):
    """As `posed`, of the hand that ends in a stump."""
    return posed_hands(hand_without_arm)


def posed_hands(hand):
    """The function that `posed` is, of any model of the built-in hand; each hand is posed once."""

    @cache
    def pose(gesture, side="right"):
        angles = (GESTURES.get(gesture) or POSES[gesture].gesture).angles_deg()
        theta = theta_of(angles, FingerAxes.of_default_hand(), np.array([0.2, -0.1, 0.3]))
        theta = torch.as_tensor(theta, dtype=torch.float32)
        vertices = pose_hand(SkinTensors.of(hand), theta, torch.zeros(10), torch.zeros(3)).vertices
        if side == "left":
            vertices = vertices * torch.as_tensor(MIRROR_POINT, dtype=torch.float32)
        topology = topology_of(hand.for_side(side), canonical_side="right")
        return PosedHand(topology, Skinning.of(hand), posed_mesh(topology, vertices), theta)

    return pose


@pytest.fixture(scope="session")
def fine_hand(hand):
    """A function (gesture or library pose, side="right") -> `DetailMesh` of the built-in hand, without veins."""
    surface = load_detail_surface(hand.sha256)

    @cache
    def pose(gesture, side="right"):
        angles = (GESTURES.get(gesture) or POSES[gesture].gesture).angles_deg()
        theta = theta_of(angles, FingerAxes.of_default_hand(), np.array([0.2, -0.1, 0.3]))
        of_side = theta if side == "right" else theta * MIRROR_AXIS_ANGLE
        template = DetailTemplate.of(surface, hand.for_side(side))
        motion = skin_motion(template.skin, HandPose(of_side, np.zeros(10), np.zeros(3), side))
        height_m = torch.as_tensor(1e-3 * surface.raised.height_mm(theta, 0.0), dtype=torch.float32)
        flex = torch.rand(len(motion.rest), generator=torch.Generator().manual_seed(0))
        return detail_mesh(template, motion, height_m, flex, torch.tensor(1.0))

    return pose


@pytest.fixture(scope="session")
def view_from():
    """A function (mesh, direction, size_px, ...) -> view that holds the mesh's middle in its own."""

    def view(mesh, direction, size_px=(48, 44), distance=0.6, field_m=0.25):
        middle, direction = mesh.vertices.mean(0).double().numpy(), np.array(direction, np.float64)
        focal_px = max(size_px) * distance / field_m
        K = np.array([[focal_px, 0, size_px[0] / 2 + 0.3], [0, 1.02 * focal_px, size_px[1] / 2 - 0.2], [0, 0, 1]])
        origin = middle + distance * direction / np.linalg.norm(direction)
        up = np.eye(3)[np.abs(direction).argmin()]
        return camera_tensors(Camera(K, look_at(origin, middle, up), size_px), "cpu")

    return view


@pytest.fixture(scope="session")
def spheres():
    """A function (*(centre, radius), subdivisions=4) -> posed mesh and topology of spheres, m."""

    def mesh_of(*points, subdivisions=4):
        ball = trimesh.creation.icosphere
        whole = trimesh.util.concatenate([ball(subdivisions, r).apply_translation(centre) for centre, r in points])
        vertices = torch.as_tensor(np.asarray(whole.vertices), dtype=torch.float32)
        faces = torch.as_tensor(np.asarray(whole.faces))
        edges = torch.cat([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
        topology = Topology(
            faces=faces,
            corner_uv=torch.zeros(len(faces), 3, 2),
            neighbours=face_neighbours(faces),
            edges=edges,
            edge_length_m=mean_edge_length(vertices, edges),
            frames=None,
        )
        return posed_mesh(topology, vertices), topology

    return mesh_of


@pytest.fixture(scope="session")
def nearest_face():
    """A function (points [S, 3], triangles [F, 3, 3]) -> nearest of all faces [S] and distance [S], in float64.

    Every quantity is a matrix product; the triangle test is another than the backend's: the least of the distances to
    the three edges, or to the plane where the point lies on the inner side of all three.
    """

    def search(points, triangles):
        centre = triangles.double().reshape(-1, 3).mean(0)
        found = [_nearest_of_all(part, triangles.double() - centre) for part in (points.double() - centre).split(32)]
        return tuple(torch.cat(values) for values in zip(*found, strict=True))

    return search


def _nearest_of_all(points, triangles):
    edges = triangles.roll(-1, 1) - triangles
    normal = torch.nn.functional.normalize(torch.linalg.cross(edges[:, 0], edges[:, 1]), dim=-1)
    inward = torch.linalg.cross(normal[:, None].expand(-1, 3, -1), edges, dim=-1)
    squared = torch.full((len(points), len(triangles)), torch.inf, dtype=torch.float64)
    is_over = torch.ones_like(squared, dtype=torch.bool)
    for corner, edge, side in zip(triangles.unbind(1), edges.unbind(1), inward.unbind(1), strict=True):
        length = (edge * edge).sum(1)
        along = points @ edge.T - (corner * edge).sum(1)
        share = (along / length).clamp(0, 1)
        to_corner = (points * points).sum(1)[:, None] - 2 * points @ corner.T + (corner * corner).sum(1)
        squared = torch.minimum(squared, to_corner - 2 * share * along + share * share * length)
        is_over &= points @ side.T >= (corner * side).sum(1)
    height = points @ normal.T - (triangles[:, 0] * normal).sum(1)
    least, face = torch.where(is_over, height * height, squared).min(1)
    return face, least.clamp(min=0).sqrt()


@pytest.fixture(params=[ReferenceBackend, *FASTER], ids=lambda backend: backend.__name__)
def backend(request):
    """Every backend on the CPU, one after the other: a stage has one test for all."""
    return request.param()


@pytest.fixture(params=FASTER, ids=lambda backend: backend.__name__)
def backend_pair(request):
    """(A faster backend, the reference): for stages whose values are known from the reference alone."""
    return request.param(), ReferenceBackend()


@pytest.fixture(scope="session")
def painted_capture(tmp_path_factory):
    """Two poses from four cameras, 24 x 32 px: 2 x 3 training views, and the fourth camera's held out."""
    hand = load_default_hand()
    folder = tmp_path_factory.mktemp("painted")
    poses = tuple(_pose(hand, gesture) for gesture in ("relaxed", "open"))
    views = []
    for pose_index in range(len(poses)):
        for camera_index, direction in enumerate(([0, 1, 0.2], [0.1, 1, -0.6], [0.1, 0.7, 0.9], [0.2, 0.9, 0.4])):
            split = "train" if camera_index < 3 else "test"
            name = f"{pose_index}_{camera_index}.png"
            views.append(CaptureView(name, _camera(np.array(direction)), camera_index, pose_index, split))
    capture = Capture(folder, hand.sha256, {"made_by": "test"}, poses, tuple(views))
    save_capture_index(capture)
    for view in views:
        _draw(hand, poses[view.pose_index], view.camera, folder / view.file)
    return capture


@pytest.fixture(scope="session")
def lit_capture(painted_capture, tmp_path_factory):
    """The painted capture, its colours shown as half a sky's and half a sun's light."""
    folder = tmp_path_factory.mktemp("lit")
    views, lights = [], []
    for view in painted_capture.views:
        pixels = painted_capture.read_image(view)
        occluders = SLAB if view.camera_index == 1 else np.zeros((0, 3, 3))
        for group, light in enumerate((SKY, SUN)):
            name = f"{view.file[:-4]}_g{group}.exr"
            colour = pixels[..., :3] * (0.5 if group else (0.2, 0.3, 0.4))
            channels = np.concatenate([colour, pixels[..., 3:]], -1).astype(np.float16)
            write_exr(folder / name, {channel: channels[..., k] for k, channel in enumerate("RGBA")})
            kind, albedo = "hard" if group else "dome", np.full((len(occluders), 3), 0.5)
            lights.append(CaptureLight(kind, replace(light, occluders=occluders, occluder_albedo=albedo)))
            views.append(replace(view, file=name, light=len(lights) - 1))
    known = (painted_capture.hand_sha256, {"made_by": "test"}, painted_capture.poses)
    lit = Capture(folder, *known, tuple(views), tuple(lights))
    save_capture_index(lit)
    return lit


def _pose(hand, gesture):
    theta = theta_of(GESTURES[gesture].angles_deg(), FingerAxes.of_default_hand())
    return HandPose(theta, np.zeros(10), -hand.joints[4])


def _camera(direction, distance=0.6):
    focal_px = SIZE[1] * distance / 0.25
    K = np.array([[focal_px, 0, SIZE[0] / 2], [0, focal_px, SIZE[1] / 2], [0, 0, 1]])
    origin = distance * direction / np.linalg.norm(direction)
    return Camera(K, look_at(origin, np.zeros(3), np.array([-1.0, 0, 0])), SIZE)


def _draw(hand, pose, camera, path: Path, finer=4):
    """Area-averaged: drawn at four times the resolution."""
    vertices = pose_hand(
        SkinTensors.of(hand, dtype=torch.float64),
        *(torch.as_tensor(value) for value in (pose.theta, pose.beta, pose.transl)),
    ).vertices.numpy()
    large = camera.scaled(float(finer))
    positions_px, depth = large.project(vertices)
    fragments = rasterise(*(torch.as_tensor(value) for value in (positions_px, depth, hand.f)), large.size_px)
    width, height = large.size_px
    order = torch.argsort(fragments.depth, descending=True)
    image = np.zeros((height * width, 4))
    colour = 0.5 + 0.4 * np.sin(hand.v_template[hand.f].mean(1) * (40, 70, 60))
    for pixel, face in zip(fragments.pixel[order].tolist(), fragments.face[order].tolist(), strict=True):
        image[pixel] = (*colour[face], 1)
    small = image.reshape(height // finer, finer, width // finer, finer, 4).mean((1, 3))
    straight = np.concatenate([small[..., :3] / np.maximum(small[..., 3:], 1e-9), small[..., 3:]], -1)
    Image.fromarray((straight * 255).round().astype(np.uint8)).save(path)
