"""A model of lit frames on Warp's device: its tables, and the weights of its networks."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, pi, sin
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import torch
import warp as wp
from torch import Tensor, nn

from ...image.superres import ResidualSuperRes
from ...light.prefiltered_environment import PrefilteredEnvironment
from ...surface.blood import JointBlood
from ...surface.detail_mesh import faces_around
from ...surface.hole_filling import DIRECTIONS, RINGS_PX
from ..whole_frames import FrameModel, LitModel
from .field_stages import FlatField
from .kernels.tiles import COLUMNS, DEPTH


class Layer(NamedTuple):
    """A layer of a network as `multiply_rows` takes it: weight [taps, C, D], bias [1, D], slope, and share kept."""

    weight: wp.array
    bias: wp.array
    slope: float
    kept: float

    @property
    def inputs(self) -> int:
        """Columns of what it reads."""
        return self.weight.shape[1]

    @property
    def outputs(self) -> int:
        """Columns of what it fills: whole tiles."""
        return self.weight.shape[2]

    @property
    def blocks(self) -> int:
        """Tiles side by side."""
        return self.outputs // int(COLUMNS)


class Networks(NamedTuple):
    """The layers of a decoder and of super-resolution, in one precision."""

    decoder: tuple[Layer, ...]
    superres: tuple[Layer, ...]


Model = TypeVar("Model", bound=FrameModel)
Tables = dict[str, tuple[Any, Any]]
"""Name -> (values, Warp's type of an element)."""


@dataclass(frozen=True)
class DeviceModel(Generic[Model]):
    """A model on a device, whatever the shape of its frames.

    Attributes:
        model: as given.
        device: Warp's name of it.
        tables: by name.
        networks: in the device's precision.
    """

    model: Model
    device: str
    tables: dict[str, wp.array]
    networks: Networks

    @classmethod
    def of(cls, model: Model, own: Tables, device: str) -> DeviceModel[Model]:
        """Copy a model, and tables that its kind of frame has alone, to a device."""
        given = {**shared_tables(model), **own}
        tables = {name: device_array(values, kind, device) for name, (values, kind) in given.items()}
        return cls(model, device, tables, networks_of(model, precision_on(device), device))


def precision_on(device: str) -> Any:
    """Return the type of numbers in networks: half where they are products of tiles, on GPUs."""
    return wp.float16 if wp.get_device(device).is_cuda else wp.float32


def device_array(values: Tensor | np.ndarray, kind: Any, device: str) -> wp.array:
    """Copy values to a device as elements of a kind."""
    array = values.detach().cpu().numpy() if isinstance(values, Tensor) else values
    return wp.array(np.ascontiguousarray(array), dtype=kind, device=device)


def linear_layers(layers: list[nn.Linear], precision: Any, device: str) -> tuple[Layer, ...]:
    """Lay out a network with ReLUs between its layers."""
    return tuple(
        _layer(one.weight.T[None], one.bias, 1.0 if one is layers[-1] else 0.0, 0.0, precision, device)
        for one in layers
    )


def convolutions(network: ResidualSuperRes, precision: Any, device: str) -> tuple[Layer, ...]:
    """Lay out the convolutions of super-resolution."""

    def layer(weight: Tensor, bias: Tensor | None, slope: float, kept: float) -> Layer:
        taps = weight.permute(2, 3, 1, 0).flatten(0, 1)
        return _layer(taps, bias, slope, kept, precision, device)

    first = layer(network.head.weight, network.head.bias, 0.2, 0.0)
    body = [layer(one.get_parameter("weight"), one.get_parameter("bias"), 0.2, 1.0) for one in network.body.children()]
    return (first, *body, layer(*network.even_tail(), 1.0, 0.0))


def _layer(weight: Tensor, bias: Tensor | None, slope: float, kept: float, precision: Any, device: str) -> Layer:
    """Pad a layer's weight [taps, C, D] and bias to whole tiles."""
    taps, inputs, outputs = weight.shape
    columns, rows = -(-outputs // int(COLUMNS)) * int(COLUMNS), -(-inputs // 64) * 64
    assert rows % int(DEPTH) == 0
    padded, of_columns = weight.new_zeros(taps, rows, columns), weight.new_zeros(1, columns)
    padded[:, :inputs, :outputs] = weight.detach()
    if bias is not None:
        of_columns[0, :outputs] = bias.detach()
    kind = np.float16 if precision == wp.float16 else np.float32
    return Layer(
        device_array(padded.detach().cpu().numpy().astype(kind), precision, device),
        device_array(of_columns, wp.float32, device),
        slope,
        kept,
    )


def networks_of(model: FrameModel, precision: Any, device: str) -> Networks:
    """Lay out the networks of a model."""
    layers = [*model.field.trunk, model.field.channels]
    return Networks(linear_layers(layers, precision, device), convolutions(model.superres, precision, device))


def rings_around() -> np.ndarray:
    """List where rays look for others: columns and rows aside, and the square of the radius, px."""
    angles = [2 * pi * k / DIRECTIONS for k in range(DIRECTIONS)]
    return np.array([(round(r * cos(a)), round(r * sin(a)), round(r * r)) for r in RINGS_PX for a in angles], np.int32)


@torch.no_grad()
def shared_tables(model: FrameModel) -> Tables:
    """List the tables of frames of every kind: the mesh and the field of planes."""
    topology, flat = model.topology, FlatField.of(model.field)
    start, around = faces_around(topology.faces, model.vertices)
    return {
        "faces": (topology.faces, wp.int64),
        "corner_uv": (topology.corner_uv, wp.float32),
        "neighbours": (topology.neighbours, wp.int64),
        "start": (start, wp.int64),
        "around": (around, wp.int64),
        "frame_neighbours": (topology.frames.neighbours, wp.int64),
        "frame_weights": (topology.frames.weights, wp.float32),
        "frame_template": (topology.frames.template, wp.mat33),
        "skinning": (model.skinning.lbs_weights, wp.float32),
        "planes": (flat.table, wp.float32),
        "planes_layout": (flat.layout, wp.int32),
        "texels_m": (flat.texels_m, wp.float32),
        "near_weight": (flat.near_weight, wp.float32),
        "near_bias": (flat.near_bias, wp.float32),
        "density_weight": (flat.density_weight, wp.float32),
        "density_bias": (flat.density_bias, wp.float32),
        "one_tap": (np.zeros(1, np.int32), wp.int32),
    }


@torch.no_grad()
def lit_tables(model: LitModel) -> Tables:
    """List the tables of lit frames alone: the avatar's surface, its detail, and light."""
    skin, topology, template, maps = model.template.skin, model.topology, model.template, model.maps
    coarse = template.coarse_faces
    raised = model.raised
    blood = JointBlood(torch.zeros(0), torch.zeros(3)) if model.joint_blood is None else model.joint_blood
    given: Tables = {
        "template": (skin.v_template, wp.vec3),
        "shapedirs": (skin.shapedirs, wp.float32),
        "posedirs": (skin.posedirs, wp.float32),
        "lbs_weights": (skin.lbs_weights, wp.float32),
        "arm_weights": (skin.arm_weights, wp.float32),
        "parents": (np.array(skin.parents, np.int32), wp.int32),
        "mirror": (template.mirror[None], wp.vec3),
        "albedo": (model.albedo, wp.vec3),
        "fine_faces": (template.faces, wp.int64),
        "fine_uv": (template.corner_uv, wp.float32),
        "fine_start": (template.around[0], wp.int64),
        "fine_around": (template.around[1], wp.int64),
        "offset_m": (template.offset_m, wp.vec3),
        "resting_m": (1e-3 * raised.resting_mm, wp.float32),
        "raised_start": (raised.start, wp.int64),
        "raised_part": (raised.part, wp.int32),
        "raised_m": (1e-3 * raised.height_mm, wp.float32),
        "rest_normals": (template.normals, wp.vec3),
        "bone_of_face": (template.bones.of_face, wp.int8),
        "apart": (template.bones.apart, wp.bool),
        "casting_faces": (
            torch.cat([topology.faces, coarse + model.vertices, template.faces + model.vertices]),
            wp.int64,
        ),
        "maps": (maps.table, wp.int8),
        "maps_first": (np.array([first for first, _ in maps.levels], np.int64), wp.int64),
        "pigment_colour": (np.array(maps.pigment_colour, np.float32), wp.float32),
        "sharpness": (np.array(maps.sharpness, np.float32), wp.float32),
        "drains": (blood.drains, wp.float32),
        "drains_log_albedo": (blood.log_albedo, wp.float32),
        "ratio": (np.zeros((0, 3), np.int8) if maps.ratio is None else maps.ratio.table, wp.int8),
        "ratio_first": (np.zeros(1, np.int64) if maps.ratio is None else np.array(maps.ratio.first_rows), wp.int64),
        "rings": (rings_around(), wp.int32),
        "lobes": (PrefilteredEnvironment.of(None, "cpu").lobes, wp.float32),
    }
    for number, level in enumerate(template.levels):
        given |= {
            f"level{number}_start": (level.start, wp.int64),
            f"level{number}_column": (level.column, wp.int64),
            f"level{number}_weight": (level.weight, wp.float32),
        }
    return given
