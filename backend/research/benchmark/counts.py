"""The arithmetic and the memory traffic that a frame needs at least: what every floor is computed from.

The formulas are lower bounds. A stage reads its input and writes its output once, intermediate results stay in the
cache, and only the large terms are counted, so a stage can come near its floor but not below it. The numbers are
counted from the shot, not from the renderer, so that they do not depend on how it works: rays are the low-resolution
pixels that the inflated mesh covers, the crop is its bounding box with the margin that super-resolution needs.
"""

from __future__ import annotations

import copy
from typing import Literal, NamedTuple

import numpy as np
import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

from ...avatars.avatar import Avatar
from ...field.field import CHANNELS, PlaneField
from ...field.relightable import RelightableField
from ...field.sampler import SamplerConfig
from ...geometry.mesh import vertex_normals
from ...hand.model import HandModel
from ...image.crop import MARGIN_PX
from ...image.superres import RELIGHTABLE_DETAIL, RELIGHTABLE_MAPS, RelightableSuperRes
from ...light.lighting import COEFFICIENTS
from ...light.sky_samples import SKY_DIRECTIONS
from ...records.camera import Camera
from ...records.shot import Shot
from .motion import silhouette_px

Unit = Literal["fp32", "network"]

TRIANGLE_FLOP = 92
"""Closest point of one triangle: 23 an edge (offset 3, product 5, share 3, rest 6, square 6), and 23 for the plane."""
RING_FACES = 6
"""Mean number of faces around a vertex of a triangle mesh (Euler): the smallest neighbourhood to search."""
PIXEL_TEST_FLOP = 15
"""Three edge functions of a pixel centre: two products and three sums each."""
# Layers of a field that run neither per sample nor per ray: the pose's once a frame, the light's once a vertex.
_ONCE_A_FRAME = ("pose", "light")
# Layers of a plane field that decode rays.
_ONCE_A_RAY = ("trunk", "channels")
_LIGHT_FLOP = 15 + 25 + 6 + 18 + 26 + 42  # `light_work` says of what
_FLOAT_BYTES, _SAMPLE_BYTES = 4, 20  # a sample on the surface: face, three barycentrics, height
_POSE_FEATURES, _SHAPE_FEATURES, _JOINTS = 135, 10, 16


class Work(NamedTuple):
    """Arithmetic and memory traffic of a stage; `unit` selects the peak that the arithmetic can reach."""

    flop: float
    bytes: float
    unit: Unit = "fp32"


class Counts(NamedTuple):
    """The sizes that a frame's work depends on.

    Attributes:
        vertices: of the mesh.
        faces: of the mesh.
        pixel_tests: low-resolution pixels in the bounding boxes of all faces, of both the inflated and deflated mesh.
        rays: low-resolution pixels that the inflated mesh covers.
        samples: rays times samples per ray.
        crop_px: (width, height) of the low-resolution crop that super-resolution reads.
        size_px: the frame, (width, height).
    """

    vertices: int
    faces: int
    pixel_tests: int
    rays: int
    samples: int
    crop_px: tuple[int, int]
    size_px: tuple[int, int]


def counts_of(shot: Shot, hand: HandModel, sampler: SamplerConfig) -> Counts:
    """Count one shot, whose hand must have the template's size and lie in front of the camera."""
    camera = shot.camera.scaled(0.5)
    normals = vertex_normals(torch.as_tensor(shot.vertices), torch.as_tensor(hand.f)).numpy()
    shell = sampler.shell_m * normals
    inflated = shot.vertices + shell
    rays = silhouette_px(inflated, hand.f, camera)
    return Counts(
        vertices=len(hand.v_template),
        faces=len(hand.f),
        pixel_tests=sum(pixel_tests(vertices, hand.f, camera) for vertices in (inflated, shot.vertices - shell)),
        rays=rays,
        samples=rays * sampler.samples_per_ray,
        crop_px=_crop_px(camera.project(inflated)[0], camera.size_px),
        size_px=shot.camera.size_px,
    )


def pixel_tests(vertices: np.ndarray, faces: np.ndarray, camera: Camera) -> int:
    """Count pixel centres in the bounding boxes of all projected faces, inside the image."""
    corners = camera.project(vertices)[0][faces]
    first = np.ceil(corners.min(1) - 0.5).clip(0)
    last = np.floor(corners.max(1) - 0.5).clip(max=np.array(camera.size_px) - 1)
    return int((last - first + 1).clip(0).prod(-1).sum())


def pose_work(counts: Counts) -> Work:
    """Blend shapes V x 3 x (135 + 10), skinning V x 16 x 12; the model's arrays are read once."""
    terms = 3 * (_POSE_FEATURES + _SHAPE_FEATURES)
    flop = 2 * counts.vertices * (terms + 12 * _JOINTS)
    return Work(flop, _FLOAT_BYTES * counts.vertices * (terms + _JOINTS + 3))


def rasterise_work(counts: Counts) -> Work:
    """Count 15 FLOP per pixel test; reads the corners of two meshes, writes an interval (index, start, end) per ray."""
    return Work(PIXEL_TEST_FLOP * counts.pixel_tests, _FLOAT_BYTES * (2 * 9 * counts.faces + 3 * counts.rays))


def sample_work(counts: Counts) -> Work:
    """Count six triangles per sample; reads the mesh and the rays, writes 20 bytes per sample."""
    read = _FLOAT_BYTES * (9 * counts.faces + 3 * counts.rays)
    return Work(RING_FACES * TRIANGLE_FLOP * counts.samples, read + _SAMPLE_BYTES * counts.samples)


def gather_work(counts: Counts, field: nn.Module) -> Work:
    """Count features and density of samples, where the field decodes rays: 2 FLOP per weight, 4 texels of every plane.

    Reads the samples and the touched texels of each plane, no texel twice.
    """
    of_samples, _ = weights_of(field)
    tables = [value for name, value in field.named_parameters() if name.endswith("table")]
    flop = 2 * (of_samples + sum(4 * table.shape[-1] for table in tables)) * counts.samples
    touched = sum(min(table.numel(), 4 * counts.samples * table.shape[-1]) for table in tables)
    return Work(flop, _SAMPLE_BYTES * counts.samples + _FLOAT_BYTES * (of_samples + touched))


def field_work(counts: Counts, field: nn.Module, number_bytes: int) -> Work:
    """Count 2 FLOP per weight and ray where the field decodes rays, else per weight and sample; writes 33 numbers."""
    of_samples, of_rays = weights_of(field)
    if of_rays:
        moved = counts.rays * (CHANNELS + 1) + of_rays
        return Work(2 * of_rays * counts.rays, number_bytes * moved, "network")
    moved = number_bytes * (counts.samples * (CHANNELS + 1) + of_samples)
    return Work(2 * of_samples * counts.samples, moved + _SAMPLE_BYTES * counts.samples, "network")


def weights_of(field: nn.Module) -> tuple[int, int]:
    """Count the weights in the layers that run for every sample, and in those that run for every ray."""
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
    """Count 2 x 32 FLOP per sample for the sums and 8 for its weight; reads 33 numbers, writes 34 per ray."""
    moved = number_bytes * (CHANNELS + 1) * counts.samples + _FLOAT_BYTES * (CHANNELS + 2) * counts.rays
    return Work((2 * CHANNELS + 8) * counts.samples, moved)


def superres_work(counts: Counts, superres: nn.Module, number_bytes: int) -> Work:
    """Count the products over the crop, as torch does; reads 33 maps, writes RGBA of twice the size.

    Of a relightable avatar, it reads 34 maps and writes 12.
    """
    width, height = counts.crop_px
    read, written = (
        (RELIGHTABLE_MAPS, RELIGHTABLE_DETAIL) if isinstance(superres, RelightableSuperRes) else (CHANNELS + 1, 4)
    )
    network = copy.deepcopy(superres).float().to("meta")
    with FlopCounterMode(display=False) as counter, torch.inference_mode():
        network(torch.empty(1, read, height, width, device="meta"))
    weights = sum(parameter.numel() for parameter in superres.parameters())
    numbers = (read + 4 * written) * width * height + weights
    return Work(counter.get_total_flops(), number_bytes * numbers, "network")


def light_work(counts: Counts) -> Work:
    """Count the sky alone: shadows and features of every ray in every direction, and the product at full size.

    A ray and direction: 15 FLOP to project the point, 25 to compare it with four pixels of a map, 6 for its share of
    the light, 18 to sum that, 26 for two depths of scattered light and 42 for two lobes. A pixel of the hand at full
    size: 4 rays' 21 numbers blended, and 14 coefficients times these. Reads the points, writes features and RGB.
    """
    pairs, pixels = SKY_DIRECTIONS * counts.rays, 4 * counts.rays
    moved = _FLOAT_BYTES * (2 * 12 * counts.rays + 21 * counts.rays + (COEFFICIENTS + 6 + 4 + 3) * pixels)
    return Work(_LIGHT_FLOP * pairs + (2 * 4 * 21 + 60) * pixels, moved)


def decode_work(counts: Counts) -> Work:
    """Count about 20 FLOP per pixel of the crop (clamps, the sRGB curve); reads RGBA, depth, writes the whole frame."""
    crop = 4 * counts.crop_px[0] * counts.crop_px[1]
    return Work(20 * crop, _FLOAT_BYTES * 5 * (crop + counts.size_px[0] * counts.size_px[1]))


def stage_work(counts: Counts, avatar: Avatar, number_bytes: int) -> dict[str, Work]:
    """Count the work of every stage of a frame; `number_bytes` is 2 for bfloat16 networks, 4 for single precision."""
    return {
        "pose": pose_work(counts),
        "rasterise": rasterise_work(counts),
        "sample": sample_work(counts),
        **({"gather": gather_work(counts, avatar.field)} if isinstance(avatar.field, PlaneField) else {}),
        "field": field_work(counts, avatar.field, number_bytes),
        "volume": volume_work(counts, number_bytes),
        "superres": superres_work(counts, avatar.superres, number_bytes),
        **({"light": light_work(counts)} if isinstance(avatar.field, RelightableField) else {}),
        "decode": decode_work(counts),
    }


def _crop_px(positions_px: np.ndarray, size_px: tuple[int, int]) -> tuple[int, int]:
    first = np.floor(positions_px.min(0)).clip(0)
    last = np.ceil(positions_px.max(0)).clip(max=np.array(size_px))
    width, height = (int(side) + 2 * MARGIN_PX for side in (last - first).clip(1))
    return width, height
