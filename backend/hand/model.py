"""A hand model in MANO's format: arrays as they lie in the file, numpy, before any pose.

MANO's own names are kept. Right-hand frame of the template: fingers towards -X, back of the hand +Y, thumb +Z, metres.
Source of the format: Romero et al. 2017, "Embodied Hands"; MANO v1.2 files.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields, replace
from importlib import resources
from pathlib import Path

import numpy as np

from ..errors import LiveHandError
from ..shot import Side

JOINT_NAMES = (
    "wrist",
    *(f"{finger}{k}" for finger in ("index", "middle", "pinky", "ring", "thumb") for k in (1, 2, 3)),
)
PARENTS = (-1, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14)

# What a file must hold beside an atlas (vt, ft), which is made where it is missing.
REQUIRED_KEYS = ("v_template", "f", "weights", "J_regressor", "kintree_table", "shapedirs", "posedirs")


@dataclass(frozen=True)
class HandModel:
    """V vertices, F faces, T atlas vertices, 16 joints.

    Attributes:
        name: file stem, for people.
        side: which hand the template is.
        sha256: of the file the model came from (mirroring keeps it): the identity an avatar asks for.
        v_template: [V, 3] m.
        f: [F, 3] vertex indices, outward by the right-hand rule.
        lbs_weights: [V, 16], rows sum to 1.
        J_regressor: [16, V], rows sum to 1.
        parents: [16] index of the parent joint, -1 for the root.
        shapedirs: [V, 3, 10] m per unit of beta.
        posedirs: [V, 3, 135] m per unit of (R - I) of joints 1..15, row-major.
        vt: [T, 2] atlas coordinates in [0, 1].
        ft: [F, 3] atlas vertex of each face corner.
    """

    name: str
    side: Side
    sha256: str
    v_template: np.ndarray
    f: np.ndarray
    lbs_weights: np.ndarray
    J_regressor: np.ndarray
    parents: np.ndarray
    shapedirs: np.ndarray
    posedirs: np.ndarray
    vt: np.ndarray
    ft: np.ndarray

    @property
    def joints(self) -> np.ndarray:
        """[16, 3] rest joints of the mean shape, m."""
        return self.J_regressor @ self.v_template

    def for_side(self, side: Side) -> HandModel:
        """This hand, or its exact mirror image in the plane x = 0 where the other side is asked for."""
        return self if side == self.side else _mirrored(self)


MIRROR_POINT = np.array([-1.0, 1.0, 1.0])
MIRROR_AXIS_ANGLE = np.array([1.0, -1.0, -1.0])
# (S R S - ...) in the row-major 3x3 entries of R: the sign each entry takes when R is mirrored.
_MIRROR_MATRIX = np.outer(MIRROR_POINT, MIRROR_POINT).ravel()


def _mirrored(model: HandModel) -> HandModel:
    posedirs = model.posedirs * MIRROR_POINT[:, None] * np.tile(_MIRROR_MATRIX, 15)
    return replace(
        model,
        side="left" if model.side == "right" else "right",
        v_template=model.v_template * MIRROR_POINT,
        f=model.f[:, ::-1].copy(),
        ft=model.ft[:, ::-1].copy(),
        shapedirs=model.shapedirs * MIRROR_POINT[:, None],
        posedirs=posedirs,
    )


def default_hand_path() -> Path:
    """Where the built-in hand's file lies."""
    return Path(str(resources.files(str(__package__)) / "hand_default.npz"))


def load_default_hand() -> HandModel:
    """The built-in right hand."""
    return load_hand_model(default_hand_path())


def load_hand_model(path: Path | str, side: Side | None = None) -> HandModel:
    """Read a `.npz` with MANO keys or one of MANO's own `.pkl` files.

    Args:
        path: the file.
        side: which hand it holds; None reads it from the file's name (`left` in it, or right).

    Raises:
        LiveHandError: no such file, a missing or malformed array, or a pickle that holds anything but a MANO hand.
    """
    path = Path(path)
    arrays = _read_arrays(path)
    missing = [key for key in REQUIRED_KEYS if key not in arrays]
    if missing:
        raise LiveHandError(f"{path} must hold a MANO-format hand; missing: {', '.join(missing)}")
    side = side or ("left" if "left" in path.stem.lower() else "right")
    model = _from_arrays(arrays, path, side)
    _check_model(model, path)
    return model


def _read_arrays(path: Path) -> dict[str, np.ndarray]:
    if not path.is_file():
        raise LiveHandError(f"no hand model at {path}; give the path of a .npz or .pkl with MANO keys")
    if path.suffix == ".pkl":
        from .mano_pickle import read_mano_pickle

        return read_mano_pickle(path)
    try:
        with np.load(path, allow_pickle=False) as archive:
            return {key: archive[key] for key in archive.files}
    except (ValueError, OSError, EOFError) as error:
        raise LiveHandError(f"{path} is not a readable .npz hand model ({error})") from error


def _from_arrays(arrays: dict[str, np.ndarray], path: Path, side: Side) -> HandModel:
    v_template = np.asarray(arrays["v_template"], np.float64)
    faces = np.asarray(arrays["f"]).astype(np.int64)
    vt, ft = _atlas(arrays, v_template, faces)
    shapedirs = np.asarray(arrays["shapedirs"], np.float64)[..., :10]
    return HandModel(
        name=path.stem,
        side=side,
        sha256=hashlib.sha256(path.read_bytes()).hexdigest(),
        v_template=v_template,
        f=faces,
        lbs_weights=np.asarray(arrays["weights"], np.float64),
        J_regressor=np.asarray(arrays["J_regressor"], np.float64),
        parents=np.r_[-1, np.asarray(arrays["kintree_table"])[0, 1:].astype(np.int64)],
        shapedirs=_unmirror_left_shapedirs(shapedirs, v_template, side),
        posedirs=np.asarray(arrays["posedirs"], np.float64),
        vt=vt,
        ft=ft,
    )


def _atlas(arrays: dict[str, np.ndarray], v_template: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    if "vt" in arrays and "ft" in arrays:
        return np.asarray(arrays["vt"], np.float64), np.asarray(arrays["ft"]).astype(np.int64)
    from .atlas import unwrap

    return unwrap(v_template, faces)


def _unmirror_left_shapedirs(shapedirs: np.ndarray, v_template: np.ndarray, side: Side) -> np.ndarray:
    """Mend MANO_LEFT.pkl, whose shapedirs are the right hand's, not mirrored in x.

    A direction that grows the hand moves vertices away from the centre along every axis. In an un-mirrored left hand
    the x part works against the y and z parts; the sign of their summed product over all ten directions tells.
    """
    if side == "right":
        return shapedirs
    centred = v_template - v_template.mean(0)
    growth = np.einsum("vc,vck->ck", centred, shapedirs) / (centred**2).sum(0)[:, None]
    is_unmirrored = (growth[0] * (growth[1] + growth[2])).sum() < 0
    return shapedirs * MIRROR_POINT[:, None] if is_unmirrored else shapedirs


def _check_model(model: HandModel, path: Path) -> None:
    """Raise if an array has the wrong shape, is not finite, or points outside another."""
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
    if tuple(model.parents) != PARENTS:
        raise LiveHandError(f"{path}: kintree_table must be MANO's tree {PARENTS}, got {tuple(model.parents)}")
    if model.f.min() < 0 or model.f.max() >= vertices or model.ft.min() < 0 or model.ft.max() >= corners:
        raise LiveHandError(f"{path}: faces must index existing vertices, got an index outside them")
