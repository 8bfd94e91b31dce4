"""Registrations of hand models in the user's data folder, each made once: a file's place tells which two and how."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ...hand.model import HandModel
from ...records.errors import LiveHandError
from ...records.shot import HandPose
from ...records.side import Side
from ...system.files import is_file, replacing
from ...system.package_files import user_folder
from ...system.readers import npz_bytes, read_npz
from .model_transfer import ModelTransfer
from .region_mesh import NearestPoints
from .registration import Registration

VERSION = 1
"""Of registrations: those of another version are made again."""
_DIGITS = 16  # of each model's sha256 in a file's name


def stored_transfer(ours: HandModel, other: HandModel) -> ModelTransfer:
    """Load the transfer between two hand models, or make and keep it; a folder that cannot be written does not matter.

    Raises:
        LiveHandError: as `ModelTransfer.of`.
    """
    try:
        path = transfer_path(ours, other)
    except LiveHandError:  # a user without a home
        return ModelTransfer.of(ours, other)
    if is_file(path):
        try:
            return ModelTransfer(ours, other, _read(path, ours, other))
        except LiveHandError:
            pass  # damaged: made again
    transfer = ModelTransfer.of(ours, other)
    try:
        _write(path, transfer.registration)
    except LiveHandError:
        pass
    return transfer


def transfer_path(ours: HandModel, other: HandModel) -> Path:
    """Return where the registration of two models is kept."""
    names = [f"{model.sha256[:_DIGITS]}{model.side[0]}" for model in (ours, other)]
    return user_folder("transfers") / f"{'-'.join(names)}-{VERSION}.npz"


def _write(path: Path, found: Registration) -> None:
    arrays = {
        **{name: getattr(found.rest, name) for name in ("theta", "beta", "transl")},
        **found.points._asdict(),
        "conformed": found.conformed,
        "weight": found.weight,
    }
    with replacing(path) as temporary:
        temporary.write_bytes(npz_bytes(arrays))


def _read(path: Path, ours: HandModel, other: HandModel) -> Registration:
    arrays = read_npz(path)
    count, side = len(ours.v_template), ours.side
    shapes = {
        "conformed": (count, 3),
        "weight": (count,),
        "face": (count,),
        "weights": (count, 3),
        "distance_m": (count,),
    }
    for name, shape in shapes.items():
        if name not in arrays or arrays[name].shape != shape or not np.isfinite(arrays[name]).all():
            raise LiveHandError(f"{path} must hold {name} {list(shape)}; remove the file")
    points = NearestPoints(arrays["face"].astype(np.int64), arrays["weights"], arrays["distance_m"])
    if points.face.min() < 0 or points.face.max() >= len(other.f):
        raise LiveHandError(f"{path} must name faces of '{other.name}'; remove the file")
    return Registration(_pose(path, arrays, side), arrays["conformed"], points, arrays["weight"])


def _pose(path: Path, arrays: dict[str, np.ndarray], side: Side) -> HandPose:
    try:
        return HandPose(arrays["theta"], arrays["beta"], arrays["transl"], side)
    except KeyError as error:
        raise LiveHandError(f"{path} must hold a pose, got none ({error}); remove the file") from error
