"""What a frame must compute and move, counted: the arithmetic and the bytes behind every floor.

The formulas are lower bounds on purpose. A stage reads its input and writes its output once, what lies between stays in
the cache, and only the large terms are counted; so a stage can come near its floor but not below it. Numbers are
counted from the shot itself, not from the renderer, so that no renderer can move its own goal: rays are the
low-resolution pixels that the inflated mesh covers, the window is its bounding box with the margin that
super-resolution needs.
"""

from __future__ import annotations

import copy
from typing import Literal, NamedTuple

import numpy as np
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from ..hand.model import HandModel
from ..nerf.avatar import Avatar
from ..nerf.crop import MARGIN_PX
from ..nerf.field import CHANNELS, PlaneField
from ..nerf.sampler import SamplerConfig
from ..records.camera import Camera
from ..records.shot import Shot
from .motion import silhouette_px

Unit = Literal["fp32", "network"]

TRIANGLE_FLOP = 92
"""Closest point of one triangle: 23 an edge (offset 3, product 5, share 3, rest 6, square 6), and 23 for the plane."""
RING_FACES = 6
"""Faces around a vertex of a triangle mesh, on average (Euler): the least neighbourhood to look for the closest in."""
PIXEL_TEST_FLOP = 15
"""Three edge functions of a pixel centre: two products and three sums each."""
# Layers of a field that run neither per sample nor per ray: its pose's part once a frame, its light once a vertex.
_ONCE_A_FRAME = ("pose", "light")
# Layers of a field of planes that decode rays.
_ONCE_A_RAY = ("trunk", "channels")
_FLOAT, _SAMPLE_BYTES = 4, 20  # a laid-out sample: face, three barycentrics, height
_POSE_FEATURES, _SHAPE_FEATURES, _JOINTS = 135, 10, 16


class Work(NamedTuple):
    """Arithmetic and memory traffic of a stage; `unit` says at which peak the arithmetic may run."""

    flop: float
    bytes: float
    unit: Unit = "fp32"


class Counts(NamedTuple):
    """One frame in numbers.

    Attributes:
        vertices: of the mesh.
        faces: of the mesh.
        pixel_tests: low-resolution pixels in the bounding boxes of all faces, of the inflated and the deflated mesh.
        rays: low-resolution pixels that the inflated mesh covers.
        samples: rays times samples a ray.
        window_px: low-resolution pixels that super-resolution must see, (width, height).
        size_px: the frame, (width, height).
    """

    vertices: int
    faces: int
    pixel_tests: int
    rays: int
    samples: int
    window_px: tuple[int, int]
    size_px: tuple[int, int]


def counts_of(shot: Shot, hand: HandModel, sampler: SamplerConfig) -> Counts:
    """Count one shot; its hand must be of the template's size and in front of the camera."""
    camera = shot.camera.scaled(0.5)
    shell = sampler.shell_m * vertex_normals(shot.vertices, hand.f)
    inflated = shot.vertices + shell
    rays = silhouette_px(inflated, hand.f, camera)
    return Counts(
        vertices=len(hand.v_template),
        faces=len(hand.f),
        pixel_tests=sum(pixel_tests(vertices, hand.f, camera) for vertices in (inflated, shot.vertices - shell)),
        rays=rays,
        samples=rays * sampler.samples_per_ray,
        window_px=_window_px(camera.project(inflated)[0], camera.size_px),
        size_px=shot.camera.size_px,
    )


def vertex_normals(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """[V, 3] area-weighted, unit length."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    summed = np.zeros_like(vertices)
    for corner in range(3):
        np.add.at(summed, faces[:, corner], np.cross(b - a, c - a))
    return summed / np.linalg.norm(summed, axis=-1, keepdims=True)


def pixel_tests(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> int:
    """Pixel centres in the bounding boxes of all projected faces, inside the image."""
    corners = camera.project(vertices)[0][faces]
    first = np.ceil(corners.min(1) - 0.5).clip(0)
    last = np.floor(corners.max(1) - 0.5).clip(max=np.array(camera.size_px) - 1)
    return int((last - first + 1).clip(0).prod(-1).sum())


def pose_work(counts: Counts) -> Work:
    """Correctives V x 3 x (135 + 10), blending V x 16 x 12; the model's arrays are read once."""
    terms = 3 * (_POSE_FEATURES + _SHAPE_FEATURES)
    flop = 2 * counts.vertices * (terms + 12 * _JOINTS)
    return Work(flop, _FLOAT * counts.vertices * (terms + _JOINTS + 3))


def rasterise_work(counts: Counts) -> Work:
    """15 FLOP a pixel test; two meshes' corners are read, an interval (index, start, end) a ray is written."""
    return Work(PIXEL_TEST_FLOP * counts.pixel_tests, _FLOAT * (2 * 9 * counts.faces + 3 * counts.rays))


def sample_work(counts: Counts) -> Work:
    """Six triangles a sample; the mesh and the rays are read, 20 bytes a sample are written."""
    read = _FLOAT * (9 * counts.faces + 3 * counts.rays)
    return Work(RING_FACES * TRIANGLE_FLOP * counts.samples, read + _SAMPLE_BYTES * counts.samples)


def gather_work(counts: Counts, field: nn.Module) -> Work:
    """Features and density of samples, where a field decodes rays: 2 FLOP a weight, 4 texels of every plane.

    Samples are read; of each plane what is touched is read, but no texel twice.
    """
    of_samples, _ = weights_of(field)
    tables = [value for name, value in field.named_parameters() if name.endswith("table")]
    flop = 2 * (of_samples + sum(4 * table.shape[-1] for table in tables)) * counts.samples
    touched = sum(min(table.numel(), 4 * counts.samples * table.shape[-1]) for table in tables)
    return Work(flop, _SAMPLE_BYTES * counts.samples + _FLOAT * (of_samples + touched))


def field_work(counts: Counts, field: nn.Module, number_bytes: int) -> Work:
    """2 FLOP a weight and ray, where the field decodes rays, or else a weight and sample; 33 numbers each written."""
    of_samples, of_rays = weights_of(field)
    if of_rays:
        moved = counts.rays * (CHANNELS + 1) + of_rays
        return Work(2 * of_rays * counts.rays, number_bytes * moved, "network")
    moved = number_bytes * (counts.samples * (CHANNELS + 1) + of_samples)
    return Work(2 * of_samples * counts.samples, moved + _SAMPLE_BYTES * counts.samples, "network")


def weights_of(field: nn.Module) -> tuple[int, int]:
    """Weights of the layers that run for every sample, and of those that run for every ray."""
    by_ray = _ONCE_A_RAY if isinstance(field, PlaneField) else ()
    of_samples = of_rays = 0
    for name, module in field.named_modules():
        part = name.split(".")[0]
        if not isinstance(module, nn.Linear) or part in _ONCE_A_FRAME:
            continue
        of_samples += 0 if part in by_ray else module.weight.numel()
        of_rays += module.weight.numel() if part in by_ray else 0
    return of_samples, of_rays


def volume_work(counts: Counts, number_bytes: int) -> Work:
    """2 x 32 FLOP a sample for the sums and 8 for its weight; 33 numbers a sample are read, 34 a ray are written."""
    moved = number_bytes * (CHANNELS + 1) * counts.samples + _FLOAT * (CHANNELS + 2) * counts.rays
    return Work((2 * CHANNELS + 8) * counts.samples, moved)


def superres_work(counts: Counts, superres: nn.Module, number_bytes: int) -> Work:
    """The products over the window, as torch counts them; 33 maps are read, RGBA of twice the size is written."""
    width, height = counts.window_px
    network = copy.deepcopy(superres).float().to("meta")
    with FlopCounterMode(display=False) as counter, torch.inference_mode():
        network(torch.empty(1, CHANNELS + 1, height, width, device="meta"))
    weights = sum(parameter.numel() for parameter in superres.parameters())
    numbers = (CHANNELS + 1 + 4 * 4) * width * height + weights
    return Work(counter.get_total_flops(), number_bytes * numbers, "network")


def develop_work(counts: Counts) -> Work:
    """About 20 FLOP a window pixel (clamps, the sRGB curve); RGBA and depth are read, and written over the frame."""
    window = 4 * counts.window_px[0] * counts.window_px[1]
    return Work(20 * window, _FLOAT * 5 * (window + counts.size_px[0] * counts.size_px[1]))


def stage_work(counts: Counts, avatar: Avatar, number_bytes: int) -> dict[str, Work]:
    """The work of every stage of a frame; `number_bytes` is 2 for bfloat16 networks, 4 for single precision."""
    return {
        "pose": pose_work(counts),
        "rasterise": rasterise_work(counts),
        "sample": sample_work(counts),
        **({"gather": gather_work(counts, avatar.field)} if isinstance(avatar.field, PlaneField) else {}),
        "field": field_work(counts, avatar.field, number_bytes),
        "volume": volume_work(counts, number_bytes),
        "superres": superres_work(counts, avatar.superres, number_bytes),
        "develop": develop_work(counts),
    }


def _window_px(positions_px: np.ndarray, size_px: tuple[int, int]) -> tuple[int, int]:
    first = np.floor(positions_px.min(0)).clip(0)
    last = np.ceil(positions_px.max(0)).clip(max=np.array(size_px))
    width, height = (int(side) + 2 * MARGIN_PX for side in (last - first).clip(1))
    return width, height
