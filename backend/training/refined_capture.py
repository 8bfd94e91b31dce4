"""A capture with refined poses as a folder of its own, which every command reads; its images stay where they are."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..captures.capture import Capture, save_capture_index
from ..hand.model import HandModel
from ..hand.model_file import load_hand_model
from .refinement import Refinement

HAND_FILE = "hand_{side}.npz"


def save_refined_capture(capture: Capture, refinement: Refinement, hand: HandModel, folder: Path) -> HandModel:
    """Write `transforms.json` and `poses.npz`, and the hand model where its surface was refined.

    Args:
        capture: as given.
        refinement: of that capture.
        hand: of that capture.
        folder: to write to; made if it is not there.

    Returns:
        The hand model of the refined capture, which its avatar must name as its own.
    """
    folder.mkdir(parents=True, exist_ok=True)
    refined = _refined_hand(refinement, hand, folder)
    provenance = {**capture.provenance, "refined_by": "livehand train"}
    poses, sha256 = refinement.poses(), refined.sha256
    save_by_reference(replace(capture, hand_sha256=sha256, provenance=provenance, poses=poses), folder)
    return refined


def save_by_reference(capture: Capture, folder: Path) -> None:
    """Write the capture's index to another folder, whose images are the ones of the capture's own."""
    folder.mkdir(parents=True, exist_ok=True)
    views = tuple(replace(view, file=_seen_from(folder, capture.folder / view.file)) for view in capture.views)
    save_capture_index(replace(capture, folder=folder, views=views))


def _seen_from(folder: Path, image: Path) -> str:
    return Path(os.path.relpath(image.resolve(), folder.resolve())).as_posix()


def _refined_hand(refinement: Refinement, hand: HandModel, folder: Path) -> HandModel:
    if refinement.config.surface_deviation_m == 0:
        return hand
    arrays = {
        "v_template": refinement.template().double().cpu().numpy(),
        "f": hand.f,
        "weights": hand.lbs_weights,
        "J_regressor": hand.J_regressor,
        "kintree_table": np.stack([hand.parents, np.arange(len(hand.parents))]),
        "shapedirs": hand.shapedirs,
        "posedirs": hand.posedirs,
        "vt": hand.vt,
        "ft": hand.ft,
    }
    path = folder / HAND_FILE.format(side=hand.side)
    partial = path.with_suffix(".partial")
    with partial.open("wb") as file:
        np.savez_compressed(file, **arrays)
    partial.replace(path)
    return load_hand_model(path)
