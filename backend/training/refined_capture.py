"""Pose refinement as a correction in training, and the folder of the refined capture, which refers to the images."""

from __future__ import annotations

import os
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import torch

from ..avatars.avatar import Avatar
from ..capture.capture import Capture, save_capture_index
from ..capture.half_size import at_own_size
from ..hand.model import HandModel
from ..hand.model_file import ARM_KEY, load_hand_model
from ..system.files import replacing
from ..system.readers import npz_bytes
from .parts import Correction
from .refinement import Refinement, RefinementConfig

HAND_FILE = "hand_{side}.npz"


def refined_poses(
    capture: Capture, hand: HandModel, config: RefinementConfig, folder: Path, device: torch.device
) -> Correction:
    """Make the correction of poses, shape and surface; at the end the refined capture is written to `folder`.

    If the surface is refined, the avatar belongs to the refined hand model, on which no other surface lies.
    """
    refinement = Refinement(capture, hand, config, device)

    def finish(avatar: Avatar) -> Avatar:
        refined = save_refined_capture(capture, refinement, hand, folder)
        surface = avatar.surface if refined.sha256 == hand.sha256 else None
        return replace(avatar, hand_name=refined.name, hand_sha256=refined.sha256, surface=surface)

    return Correction(
        name="refinement",
        module=refinement,
        learning_rate=config.learning_rate,
        begin=lambda views, state: refinement.begin_step(views, state.step, state.progress),
        before=lambda view, source: refinement.refined(view, source.pose_index),
        penalty=lambda: {"refinement": refinement.penalty()},
        finish=finish,
        settings=asdict(config),
    )


def save_refined_capture(capture: Capture, refinement: Refinement, hand: HandModel, folder: Path) -> HandModel:
    """Write `transforms.json` and `poses.npz`, and the hand model if its surface was refined.

    The images are the original's files, and so are the cameras, also where training sees them at half their size.

    Args:
        capture: the original capture.
        refinement: of that capture.
        hand: of that capture.
        folder: to write to; created if necessary.

    Returns:
        The hand model of the refined capture, to which the avatar belongs.
    """
    folder.mkdir(parents=True, exist_ok=True)
    refined = _refined_hand(refinement, hand, folder)
    capture = at_own_size(capture)
    provenance = {**capture.provenance, "refined_by": "livehand train"}
    poses, sha256 = refinement.poses(), refined.sha256
    reported = replace(capture, hand_sha256=sha256, provenance=provenance, poses=poses)
    save_by_reference(reported if sha256 == hand.sha256 else replace(reported, surface=None), folder)
    return refined


def save_by_reference(capture: Capture, folder: Path) -> None:
    """Write the index of the capture to another folder, with its masks; it refers to the images in its own folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for mask in {view.mask for view in capture.views if view.mask is not None}:
        with replacing(folder / mask) as temporary:
            shutil.copyfile(capture.folder / mask, temporary)
    views = tuple(replace(view, file=_relative_path(folder, capture.folder / view.file)) for view in capture.views)
    surface = capture.surface
    if surface is not None:
        surface = surface._replace(file=_relative_path(folder, capture.folder / surface.file))
    save_capture_index(replace(capture, folder=folder, views=views, surface=surface))


def _relative_path(folder: Path, image: Path) -> str:
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
        **({ARM_KEY: hand.arm_weights} if hand.has_arm else {}),
    }
    path = folder / HAND_FILE.format(side=hand.side)
    with replacing(path) as temporary:
        temporary.write_bytes(npz_bytes(arrays))
    return load_hand_model(path)
