"""The file of a surface beside a capture: an `.npz` of its arrays, and of its description in JSON."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from ..system.files import replacing
from ..system.readers import npz_bytes, parse_json, read_npz
from .base_surface import check_base
from .stored_surface import StoredSurface, stored_surface

_DESCRIPTION = "description"


def write_surface(path: Path, surface: StoredSurface) -> None:
    """Write a surface.

    Raises:
        LiveHandError: the file cannot be written.
    """
    description = np.array(json.dumps(surface.description(), sort_keys=True))
    with replacing(path) as temporary:
        temporary.write_bytes(npz_bytes({**surface.arrays, _DESCRIPTION: description}))


def read_surface(path: Path, sha256: str | None = None) -> StoredSurface:
    """Read a surface.

    Args:
        path: of the file.
        sha256: that `surface_sha256` must have; None: any.

    Raises:
        LiveHandError: the file is missing, broken, of another surface or of another version.
    """
    arrays = read_npz(path)
    if _DESCRIPTION not in arrays or arrays[_DESCRIPTION].dtype.kind != "U":
        raise LiveHandError(f"{path} must hold a description in JSON, got none; it is no file of a surface")
    description = parse_json(str(arrays.pop(_DESCRIPTION)).encode(), f"{path}: {_DESCRIPTION}")
    surface = stored_surface(description, arrays, str(path))
    if sha256 is not None and surface_sha256(surface) != sha256:
        raise LiveHandError(
            f"{path} must hold the surface with the sha256 {sha256[:12]}..., got {surface_sha256(surface)[:12]}...; "
            "copy the capture's own file, or capture it anew"
        )
    check_base(surface, str(path))
    return surface


def surface_sha256(surface: StoredSurface) -> str:
    """Compute the identity of a surface, however its file is packed."""
    digest = hashlib.sha256(json.dumps(surface.description(), sort_keys=True).encode())
    for name, values in sorted(surface.arrays.items()):
        digest.update(f"{name} {values.dtype} {list(values.shape)}".encode())
        digest.update(np.ascontiguousarray(values).data)
    return digest.hexdigest()
