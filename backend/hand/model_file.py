"""Reads hand models: `.npz` files with MANO's keys, such as the built-in hand, and MANO's own `.pkl` files.

An open surface is closed by caps, and a missing atlas is made. Errors name the malformed array.
"""

from __future__ import annotations

import hashlib
from dataclasses import fields, replace
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from ..records.side import Side
from ..system.files import is_file
from ..system.readers import read_npz
from .atlas import unwrap, with_cap_chart
from .cap import cap_faces, capped
from .model import MIRROR_POINT, PARENTS, HandModel

_FARTHEST_M = 10.0  # farther vertices keep the unwrapping busy for minutes
ARM_KEY = "arm_weights"
"""Ours, optional: see `HandModel.arm_weights`."""
REQUIRED_KEYS = ("v_template", "f", "weights", "J_regressor", "kintree_table", "shapedirs", "posedirs")


DEFAULT_HAND = "hand_with_arm"
"""The name of the hand that ships, which new scenes, captures and commands get."""


@cache
def builtin_hand_path() -> Path:
    """Return the file of the hand that ships."""
    return Path(str(resources.files(str(__package__)) / f"{DEFAULT_HAND}.npz"))


def is_builtin_hand(path: Path | str) -> bool:
    """Tell whether this is the name of the hand that ships, and not a file."""
    return str(path) == DEFAULT_HAND and not is_file(Path(path))


@cache
def builtin_sha256() -> str:
    """Return the sha256 by which avatars and captures name the hand that ships."""
    return hashlib.sha256(builtin_hand_path().read_bytes()).hexdigest()


@cache
def load_default_hand() -> HandModel:
    """Load the right hand that new scenes get, once: its arrays are shared."""
    return _read_model(builtin_hand_path(), "right")


def load_hand_model(path: Path | str, side: Side | None = None) -> HandModel:
    """Read a `.npz` with MANO keys or one of MANO's own `.pkl` files.

    Args:
        path: the file, or the name of the hand that ships.
        side: of the hand; None means left if the file's name contains `left`, else right.

    Raises:
        LiveHandError: the file or an array is missing or malformed, or a pickle holds anything but a MANO hand.
    """
    path = builtin_hand_path() if is_builtin_hand(path) else Path(path)
    if side != "left" and path == builtin_hand_path():
        return load_default_hand()
    return _read_model(path, side or ("left" if "left" in path.stem.lower() else "right"))


def _read_model(path: Path, side: Side) -> HandModel:
    arrays = _read_arrays(path)
    missing = [key for key in REQUIRED_KEYS if key not in arrays]
    if missing:
        raise LiveHandError(f"{path} must hold a MANO-format hand; missing: {', '.join(missing)}")
    model = _from_arrays(arrays, path, side)
    _check_model(model, path)
    return replace(model, shapedirs=_unmirror_left_shapedirs(model.shapedirs, model.v_template, side))


def load_hands_mean(path: Path | str) -> np.ndarray:
    """Load [15, 3] rad: the mean pose of the finger joints in a MANO file, from which many data sets count.

    Raises:
        LiveHandError: the file is missing, or has no mean pose.
    """
    return _load_extra(Path(path), "hands_mean", 45).reshape(15, 3)


def load_hands_components(path: Path | str) -> np.ndarray:
    """Load [45, 45] rad: the principal components of the finger joints in a MANO file, in rows.

    Raises:
        LiveHandError: the file is missing, or has no components.
    """
    return _load_extra(Path(path), "hands_components", 45 * 45).reshape(45, 45)


def _load_extra(path: Path, key: str, size: int) -> np.ndarray:
    arrays = _read_arrays(path)
    if key not in arrays:
        raise LiveHandError(f"{path} must hold {key}, as MANO's own files do; the poses count from it")
    values = _numbers(arrays, key, path)
    if values.size != size or not np.isfinite(values).all():
        raise LiveHandError(f"{path}: {key} must be {size} finite numbers, got {list(values.shape)}")
    return values


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    if not is_file(path):
        raise LiveHandError(f"no hand model at {path}; give the path of a .npz or .pkl with MANO keys")
    if path.suffix == ".pkl":
        from .mano_pickle import read_mano_pickle

        return read_mano_pickle(path)
    return read_npz(path)


def _from_arrays(arrays: dict[str, np.ndarray], path: Path, side: Side) -> HandModel:
    v_template, weights, regressor, shapedirs, posedirs = (
        _numbers(arrays, key, path) for key in ("v_template", "weights", "J_regressor", "shapedirs", "posedirs")
    )
    faces, vt, ft = _closed_mesh(arrays, v_template, path)
    tree = np.atleast_2d(_numbers(arrays, "kintree_table", path))
    if tree.ndim != 2 or not tree.size:
        raise LiveHandError(f"{path}: kintree_table must be [2, 16], got {list(tree.shape)}")
    return HandModel(
        name=path.stem,
        side=side,
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        v_template=v_template,
        f=faces,
        lbs_weights=weights,
        J_regressor=regressor,
        parents=np.r_[-1, tree[0, 1:].astype(np.int64)],
        shapedirs=np.atleast_1d(shapedirs)[..., :10],
        posedirs=posedirs,
        vt=vt,
        ft=ft,
        arm_weights=_numbers(arrays, ARM_KEY, path) if ARM_KEY in arrays else np.zeros(len(v_template)),
    )


def _numbers(arrays: dict[str, np.ndarray], key: str, path: Path) -> np.ndarray:
    """Convert one array to float64, which represents indices up to 2^32 exactly."""
    if arrays[key].dtype.kind not in "biuf":
        raise LiveHandError(f"{path}: {key} must hold numbers, got dtype {arrays[key].dtype}")
    return arrays[key].astype(np.float64)


def _closed_mesh(
    arrays: dict[str, np.ndarray], v_template: np.ndarray, path: Path
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Close the mesh: faces including caps, and an atlas (vt, ft) of all of them, the file's own or a new one."""
    faces = _numbers(arrays, "f", path).astype(np.int64)
    _check_triangles(path, ("v_template", v_template, 3), ("f", faces))
    if np.abs(v_template).max() > _FARTHEST_M:
        raise LiveHandError(
            f"{path}: v_template must be a hand in metres, within {_FARTHEST_M:g} m of the origin, "
            f"got {np.abs(v_template).max():.3g}; scale it"
        )
    if "vt" not in arrays or "ft" not in arrays:
        faces = capped(v_template, faces)
        return faces, *unwrap(v_template, faces)
    vt, ft = _numbers(arrays, "vt", path), _numbers(arrays, "ft", path).astype(np.int64)
    _check_triangles(path, ("vt", vt, 2), ("ft", ft))
    for cap in cap_faces(v_template, faces):
        vt, ft = with_cap_chart(vt, ft, v_template, faces, cap)
        faces = np.concatenate([faces, cap])
    return faces, vt, ft


def _unmirror_left_shapedirs(shapedirs: np.ndarray, v_template: np.ndarray, side: Side) -> np.ndarray:
    """Correct MANO_LEFT.pkl, whose shapedirs are those of the right hand, not mirrored in x.

    A direction that enlarges the hand moves vertices away from the centre along every axis. In an unmirrored left hand
    the x part has the opposite sign of the y and z parts, which the summed product over all ten directions detects.
    """
    if side == "right":
        return shapedirs
    centred = v_template - v_template.mean(0)
    growth = np.einsum("vc,vck->ck", centred, shapedirs) / (centred**2).sum(0)[:, None]
    is_unmirrored = (growth[0] * (growth[1] + growth[2])).sum() < 0
    return shapedirs * MIRROR_POINT[:, None] if is_unmirrored else shapedirs


def _check_model(model: HandModel, path: Path) -> None:
    """Raise if an array has the wrong shape or is not finite, or the tree is not MANO's."""
    vertices, corners = len(model.v_template), len(model.vt)
    expected = {
        "v_template": (vertices, 3),
        "f": (len(model.f), 3),
        "lbs_weights": (vertices, 16),
        "J_regressor": (16, vertices),
        "parents": (16,),
        "shapedirs": (vertices, 3, 10),
        "posedirs": (vertices, 3, 135),
        "vt": (corners, 2),
        "ft": (len(model.f), 3),
        "arm_weights": (vertices,),
    }
    for field in fields(model):
        value = getattr(model, field.name)
        if field.name in expected and value.shape != expected[field.name]:
            raise LiveHandError(
                f"{path}: {field.name} must be {list(expected[field.name])}, got {list(value.shape)}; "
                "a MANO-format hand has 16 joints and 10 shape directions"
            )
        if isinstance(value, np.ndarray) and not np.isfinite(value).all():
            raise LiveHandError(f"{path}: {field.name} must be finite, got NaN or infinity")
    if ((model.arm_weights < 0) | (model.arm_weights > model.lbs_weights[:, 0] + 1e-6)).any():
        raise LiveHandError(f"{path}: {ARM_KEY} must be from 0 to the weight of the wrist's joint, which they share")
    if tuple(model.parents) != PARENTS:
        raise LiveHandError(f"{path}: kintree_table must be MANO's tree {PARENTS}, got {tuple(model.parents)}")


def _check_triangles(path: Path, points: tuple[str, np.ndarray, int], faces: tuple[str, np.ndarray]) -> None:
    """Raise if (name, points [N, width], width) and (name, faces [M, 3] into them) are not a mesh."""
    (points_name, values, width), (faces_name, index) = points, faces
    for name, array, columns in ((points_name, values, width), (faces_name, index, 3)):
        if array.ndim != 2 or array.shape[1] != columns or len(array) == 0:
            raise LiveHandError(f"{path}: {name} must be [N, {columns}], got {list(array.shape)}")
    if not np.isfinite(values).all():
        raise LiveHandError(f"{path}: {points_name} must be finite, got NaN or infinity")
    if index.min() < 0 or index.max() >= len(values):
        raise LiveHandError(
            f"{path}: {faces_name} must index the {len(values)} rows of {points_name}, "
            f"got {index.min()} to {index.max()}"
        )
