"""`livehand inspect` prints what a hand model, avatar, capture or pose file holds. Readers are imported when needed."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..records.errors import LiveHandError
from ..system.command import Command
from ..system.files import is_file, is_folder
from ..system.readers import parse_json, read_npz, read_npz_parts

if TYPE_CHECKING:
    from ..surface.stored_surface import StoredSurface


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, help="an avatar, hand model, pose or landmark file, or a folder")


def _run(args: argparse.Namespace) -> dict:
    return report(inspect(args.file))


def report(facts: dict) -> dict:
    """Add a summary to the facts, a line for each."""
    width = max(map(len, facts))
    return {**facts, "summary": "\n".join(f"{key:{width}s}  {value}" for key, value in facts.items())}


def inspect(path: Path) -> dict:
    """Describe a file or folder by facts with names; `kind` says what it is.

    Raises:
        LiveHandError: the file is missing, damaged or of no known kind.
    """
    if not (is_file(path) or is_folder(path)):
        raise LiveHandError(
            f"nothing to inspect at {path}; give the path of an avatar, hand model, pose file or capture"
        )
    if is_folder(path):
        return _capture_facts(path) if _is_capture(path) else _motion_facts(path)
    if path.suffix == ".safetensors":
        return _avatar_facts(path)
    if path.suffix == ".npz":
        arrays = read_npz_parts(path).arrays
        return _hand_facts(path) if "v_template" in arrays else _pose_facts(path, arrays)
    if path.suffix == ".pkl":
        return _pickle_facts(path)
    return _motion_facts(path)


def _is_capture(folder: Path) -> bool:
    return (folder / "transforms.json").exists() or not any(path.is_file() for path in folder.iterdir())


def _pickle_facts(path: Path) -> dict:
    """Describe a hand model or pose file; if neither can be read, the hand model's error is raised."""
    try:
        return _hand_facts(path)
    except LiveHandError as error:
        try:
            return _motion_facts(path)
        except LiveHandError:
            raise error from None


def _motion_facts(path: Path) -> dict:
    from ..motion.files.open_files import open_motion_file
    from ..motion.files.summary import file_summary

    return {"kind": "motion", **file_summary(open_motion_file(path), fits_landmarks=True)}


def _avatar_facts(path: Path) -> dict:
    from ..avatars.file import read_header, read_surface_of

    header = read_header(path)
    provenance = header.get("provenance")
    capture = provenance.get("capture") if isinstance(provenance, dict) else None
    surface = _surface_facts(read_surface_of(path))
    return {"kind": "avatar", **header, "surface": surface, **_skin_facts(capture)}


def _capture_facts(folder: Path) -> dict:
    from ..avatars.captured_surface import surface_of_capture
    from ..capture.capture import load_capture
    from ..hand.model_file import load_default_hand
    from ..motion.capture_gate import capture_doubt

    capture = load_capture(folder)
    surface = surface_of_capture(capture)
    doubt = capture_doubt(capture, load_default_hand())
    sizes = Counter("x".join(map(str, view.camera.size_px)) for view in capture.views)
    return {
        "kind": "capture",
        "hand_sha256": capture.hand_sha256,
        "poses": len(capture.poses),
        "cameras": len({view.camera_index for view in capture.views}),
        "images": len(capture.views),
        "splits": dict(Counter(view.split for view in capture.views)),
        "sizes_px": dict(sizes),
        "provenance": capture.provenance,
        "surface": _surface_facts(surface),
        **_skin_facts(capture.provenance),
        **({"check": doubt} if doubt else {}),
    }


def _surface_facts(surface: StoredSurface | None) -> dict[str, Any] | None:
    """Report the person's numbers, the arrays of the surface itself, and how certain they are; None: no surface."""
    if surface is None:
        return None
    own = {name: f"{values.dtype} {list(values.shape)}" for name, values in surface.arrays.items()}
    facts = {**surface.description(), "own_arrays": own}
    if "confidence" in surface.arrays:
        confidence = surface.arrays["confidence"]
        facts["confidence_mean"] = round(float(confidence.mean()) / 255, 4)
        facts["share_seen"] = round(float((confidence > 0).mean()), 4)
    return facts


def _skin_facts(capture: Any) -> dict[str, bool]:
    """Tell whether a capture, by its provenance, shows today's built-in skin; nothing where it does not tell."""
    from ..surface.skin_version import is_current_skin

    is_current = is_current_skin(capture)
    return {} if is_current is None else {"skin_is_current": is_current}


def _hand_facts(path: Path) -> dict:
    from ..hand.model_file import load_hand_model

    hand = load_hand_model(path)
    extent_mm = (np.ptp(hand.v_template, axis=0) * 1000).round(1).tolist()
    return {
        "kind": "hand model",
        "name": hand.name,
        "side": hand.side,
        "vertices": len(hand.v_template),
        "faces": len(hand.f),
        "atlas_vertices": len(hand.vt),
        "extent_mm": extent_mm,
        "sha256": hand.sha256,
        **_hand_provenance(path),
    }


def _hand_provenance(path: Path) -> dict:
    """Describe the source of a model made from a user's mesh."""
    arrays = read_npz(path) if path.suffix == ".npz" else {}
    if "provenance" not in arrays:
        return {}
    return {"provenance": parse_json(str(arrays["provenance"]).encode(), f"{path}: provenance")}


def _pose_facts(path: Path, arrays: dict[str, np.ndarray]) -> dict:
    shapes = {key: list(array.shape) for key, array in arrays.items()}
    if len(shapes.get("theta", [])) != 3 or arrays["theta"].size == 0 or arrays["theta"].dtype.kind not in "iuf":
        return _motion_facts(path)
    theta = arrays["theta"]
    if not np.isfinite(theta).all():
        raise LiveHandError(f"{path} must hold finite angles, got NaN or infinity; export the poses again")
    return {
        "kind": "poses",
        "frames": len(theta),
        "arrays": shapes,
        "is_finite": bool(np.isfinite(theta).all()),
        "largest_angle_deg": round(float(np.rad2deg(np.linalg.norm(theta, axis=-1).max())), 1),
        **{key: value for key, value in _motion_facts(path).items() if key in ("hand", "check")},
    }


COMMAND = Command("inspect", "print what a hand model, avatar, capture or pose file holds", _add_arguments, _run)
