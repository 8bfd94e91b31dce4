"""What a training is given and what it gives, and what is written down of it."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

from ..captures.capture import Capture
from ..hand.model import HandModel
from ..nerf.avatar import Avatar, AvatarConfig
from ..nerf.backend import Precision
from .checkpoint import Progress
from .config import TrainConfig
from .origin import Origin
from .parts import Correction
from .perceptual import PerceptualDistance


@dataclass(frozen=True)
class TrainingSetup:
    """What is fitted to what.

    Attributes:
        capture: of the hand.
        hand: the model that the capture's poses move.
        avatar_config: the networks.
        perceptual: None: without that term.
        corrections: of the capture, trained along.
        origin: the avatar to fine-tune; None: fresh weights.
    """

    capture: Capture
    hand: HandModel
    avatar_config: AvatarConfig
    perceptual: PerceptualDistance | None = None
    corrections: tuple[Correction, ...] = ()
    origin: Origin | None = None


class TrainingResult(NamedTuple):
    """A finished training.

    Attributes:
        avatar: wears the average weights.
        progress: steps and time, of all sessions.
        data_wait_share: of this session's time.
        held_out: figures of the last preview, dB; empty where there was none.
    """

    avatar: Avatar
    progress: Progress
    data_wait_share: float
    held_out: dict[str, float]


def run_identity(task: TrainingSetup, config: TrainConfig, precision: Precision, view_count: int) -> str:
    """Everything that shapes the result: a checkpoint goes on only with the same."""
    corrections = {correction.name: [correction.learning_rate, correction.settings] for correction in task.corrections}
    origin = task.origin.sha256 if task.origin else None
    avatar_config, capture = asdict(task.avatar_config), task.capture.provenance
    return json.dumps([asdict(config), avatar_config, capture, view_count, precision, corrections, origin])


def provenance_of(task: TrainingSetup, config: TrainConfig, precision: Precision, progress: Progress) -> dict[str, Any]:
    """What the avatar's header says of its training."""
    provenance = {
        "made_by": "livehand train",
        "training": asdict(config),
        "steps_taken": progress.step,
        "steps_skipped": progress.skipped,
        "precision": precision,
        "capture": task.capture.provenance,
        "licence": config.licence,
    }
    if task.corrections:
        provenance["corrections"] = {correction.name: correction.settings for correction in task.corrections}
    if task.origin:
        provenance["fine_tuned_from"] = task.origin.provenance()
    return provenance
