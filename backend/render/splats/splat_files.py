"""Files of splats: PLY as the first 3D Gaussian splatting wrote it, and glTF with KHR_gaussian_splatting."""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from ...image.srgb import srgb_to_linear
from ...motion.spaces import TO_BLENDER
from ...records.errors import LiveHandError
from ...system.files import replacing
from .gaussians import MIDDLE, Splats

SUFFIXES = (".ply", ".glb")
_EXTENSION = "KHR_gaussian_splatting"
_Y_DOWN = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
_POINTS, _FLOAT, _ARRAY_BUFFER = 0, 5126, 34962
_JSON_CHUNK, _BINARY_CHUNK = 0x4E4F534A, 0x004E4942


def file_axes(path: Path) -> np.ndarray:
    """Return the rotation [3, 3] from the world (Z up) to a file's axes: Y down in PLY, Y up in glTF.

    Raises:
        LiveHandError: its suffix is of neither.
    """
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise LiveHandError(f"a file of splats must end in {' or '.join(SUFFIXES)}, got {path.name!r}; rename it")
    return _Y_DOWN if suffix == ".ply" else TO_BLENDER["y_up"][:3, :3].T


def write_splats(path: Path, splats: Splats, facts: Mapping[str, str]) -> None:
    """Write splats, which are in `file_axes`, in the format of the suffix, atomically.

    Args:
        path: to be written.
        splats: of all hands.
        facts: of the hands and the fit, a line each.
    """
    content = _ply(splats, facts) if path.suffix.lower() == ".ply" else _glb(splats, facts)
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def _ply(splats: Splats, facts: Mapping[str, str]) -> bytes:
    """Return a binary PLY: logits of opacities, logarithms of scales, and harmonics by channel, then by degree."""
    of_channels = splats.harmonics[:, 1:].transpose(0, 2, 1).reshape(len(splats), -1)
    columns = {
        ("x", "y", "z"): splats.positions,
        ("nx", "ny", "nz"): splats.normals,
        _numbered("f_dc", 3): splats.harmonics[:, 0],
        _numbered("f_rest", of_channels.shape[1]): of_channels,
        ("opacity",): np.log(splats.opacity / (1 - splats.opacity))[:, None],
        _numbered("scale", 3): np.log(splats.scales),
        _numbered("rot", 4): splats.rotations,
        _numbered("albedo", 3): splats.albedo,
    }
    lines = ["ply", "format binary_little_endian 1.0"]
    lines += [f"comment {key}: {_one_line(value)}" for key, value in facts.items()]
    lines += [f"element vertex {len(splats)}"]
    lines += [f"property float {name}" for names in columns for name in names]
    header = "\n".join([*lines, "end_header", ""])
    return header.encode("ascii", "replace") + np.concatenate(list(columns.values()), 1).astype("<f4").tobytes()


def _numbered(name: str, count: int) -> tuple[str, ...]:
    return tuple(f"{name}_{index}" for index in range(count))


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _glb(splats: Splats, facts: Mapping[str, str]) -> bytes:
    """Return a binary glTF of one primitive of points, with colours for viewers that do not know splats."""
    attributes = _gltf_attributes(splats)
    arrays = [values.astype("<f4") for values in attributes.values()]
    sizes = [values.nbytes for values in arrays]
    accessors = [
        _accessor(name, index, values) for index, (name, values) in enumerate(zip(attributes, arrays, strict=True))
    ]
    kernel = {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}
    primitive = {
        "mode": _POINTS,
        "attributes": {name: index for index, name in enumerate(attributes)},
        "extensions": {_EXTENSION: kernel},
    }
    content = {
        "asset": {"version": "2.0", "generator": "LiveHand", "extras": dict(facts)},
        "extensionsUsed": [_EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0, "name": "Hand"}],
        "meshes": [{"primitives": [primitive]}],
        "accessors": accessors,
        "bufferViews": [
            {"buffer": 0, "byteOffset": sum(sizes[:index]), "byteLength": size, "target": _ARRAY_BUFFER}
            for index, size in enumerate(sizes)
        ],
        "buffers": [{"byteLength": sum(sizes)}],
    }
    text = json.dumps(content).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), _JSON_CHUNK) + text
    chunks += struct.pack("<II", sum(sizes), _BINARY_CHUNK) + b"".join(values.tobytes() for values in arrays)
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def _gltf_attributes(splats: Splats) -> dict[str, np.ndarray]:
    diffuse = splats.harmonics[:, 0] * np.sqrt(1 / (4 * np.pi)) + MIDDLE
    linear = srgb_to_linear(torch.as_tensor(diffuse).clamp(0, 1)).numpy()
    w, *xyz = splats.rotations.T
    attributes = {
        "POSITION": splats.positions,
        "NORMAL": splats.normals,
        "COLOR_0": np.concatenate([linear, splats.opacity[:, None]], 1),
        f"{_EXTENSION}:ROTATION": np.stack([*xyz, w], 1),
        f"{_EXTENSION}:SCALE": splats.scales,
        f"{_EXTENSION}:OPACITY": splats.opacity,
        "_ALBEDO": splats.albedo,
    }
    for degree in range(splats.degree + 1):
        for order in range(2 * degree + 1):
            name = f"{_EXTENSION}:SH_DEGREE_{degree}_COEF_{order}"
            attributes[name] = splats.harmonics[:, degree * degree + order]
    return attributes


def _accessor(name: str, index: int, values: np.ndarray) -> dict:
    kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
    accessor = {"bufferView": index, "componentType": _FLOAT, "count": len(values), "type": kind}
    if name == "POSITION":
        accessor |= {"min": values.min(0).tolist(), "max": values.max(0).tolist()}
    return accessor
