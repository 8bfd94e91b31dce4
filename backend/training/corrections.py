"""The corrections that `livehand train` knows, as the loop takes them: refined poses, and colours of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import torch

from ..captures.capture import Capture
from ..hand.model import HandModel
from ..nerf.avatar import Avatar
from .colour_calibration import LEARNING_RATE, ColourCalibration, training_cameras
from .parts import Correction, Rendered
from .refined_capture import save_refined_capture
from .refinement import Refinement, RefinementConfig


def refined_poses(
    capture: Capture, hand: HandModel, config: RefinementConfig, folder: Path, device: torch.device
) -> Correction:
    """Corrections of poses, shape and surface; the refined capture is written to `folder` in the end.

    The avatar belongs to the refined hand model, where its surface was refined.
    """
    refinement = Refinement(capture, hand, config, device)

    def finish(avatar: Avatar) -> Avatar:
        refined = save_refined_capture(capture, refinement, hand, folder)
        return replace(avatar, hand_name=refined.name, hand_sha256=refined.sha256)

    return Correction(
        name="refinement",
        module=refinement,
        learning_rate=config.learning_rate,
        begin=lambda views, moment: refinement.begin_step(views, moment.step, moment.share),
        before=lambda view, source: refinement.refined(view, source.pose_index),
        penalty=lambda: {"refinement": refinement.penalty()},
        finish=finish,
        settings=asdict(config),
    )


def camera_colours(capture: Capture, worn_cameras: Sequence[int]) -> Correction:
    """A gain and a bias per camera; the avatar looks as the cameras in `worn_cameras` see it, or as the fixed one."""
    cameras = training_cameras(capture)
    calibration = ColourCalibration(max(cameras) + 1, fixed_camera=cameras[0])
    if worn_cameras:
        calibration.of_cameras(worn_cameras)  # refuses ones that are not there before anything is trained

    return Correction(
        name="camera_colours",
        module=calibration,
        learning_rate=LEARNING_RATE,
        after=lambda rendered, source: Rendered(*(calibration(maps, source.camera_index) for maps in rendered)),
        finish=lambda avatar: calibration.with_networks(avatar, worn_cameras) if worn_cameras else avatar,
        settings={"worn_cameras": list(worn_cameras)},
    )
