"""Rows that are configurations of the avatars' one trainer: the paper's networks, their ablations, and ours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from time import process_time

import torch

from ...avatars.avatar import PRESETS, AvatarConfig
from ...avatars.file import load_avatar
from ...capture.capture import Capture
from ...evaluation.shot_renderer import ShotRenderer
from ...field.field import FieldConfig
from ...field.sampler import SamplerConfig
from ...hand.model import HandModel
from ...image.superres import SuperResConfig
from ...records.errors import LiveHandError
from ...render.renderer import Renderer
from ...training.checkpoint import checkpoint_path
from ...training.config import PAPER, LossConfig, ReportConfig
from ...training.loop import Training
from ...training.parts import Correction
from ...training.refined_capture import refined_poses
from ...training.refinement import RefinementConfig
from ...training.schedule import Clock
from ...training.setup import TrainingSetup
from .method import Budget, Fitted, FittingMachine
from .weights_file import parameter_count

AVATAR_FILE = "avatar.safetensors"
SAMPLES = 8
"""Samples a ray of every avatar's row, for equal cost; the paper takes 16."""

FROM_THE_START = LossConfig(perceptual_share=1.0, perceptual_rise=0.0)
"""The paper's rows have the perceptual term from the first step; our default has it in the last fifth."""
_PAPERS_LOSS = PAPER.loss
PATCH_PX = _PAPERS_LOSS.perceptual_patch_px
"""Side of the patch that the paper's ablation sees."""
_WITHOUT = LossConfig(perceptual=0.0, low_l2=0.0)
_PAPER = replace(PRESETS["paper"], sampler=SamplerConfig(samples_per_ray=SAMPLES, shell_m=0.005))


@dataclass(frozen=True)
class AvatarRow:
    """A configuration.

    Attributes:
        config: of the networks.
        loss: of the training.
        is_perceptual_needed: whether the row is meaningless without weights of the perceptual distance.
        is_refined: whether the poses are corrected in training.
    """

    name: str
    label: str
    tables: tuple[str, ...]
    notes: str
    config: AvatarConfig
    loss: LossConfig = FROM_THE_START
    is_perceptual_needed: bool = False
    is_refined: bool = False
    version: int = 1

    def fit(self, capture: Capture, hand: HandModel, budget: Budget, folder: Path, machine: FittingMachine) -> Fitted:
        """Train, or go on from the checkpoint.

        Raises:
            LiveHandError: as `training.loop.train`, or the row needs a perceptual distance and has none.
        """
        has_term = self.loss.perceptual > 0
        if self.is_perceptual_needed and machine.perceptual is None:
            raise LiveHandError(
                f"row '{self.name}' is about the perceptual loss and needs weights of VGG19; "
                "give them with --perceptual-weights, or leave the row out"
            )
        folder.mkdir(parents=True, exist_ok=True)
        output = folder / AVATAR_FILE
        perceptual = machine.perceptual if has_term else None
        corrections = self._corrections(capture, hand, output, machine)
        setup = TrainingSetup(capture, hand, self.config, perceptual, corrections)
        config = budget.train_config(seed=machine.seed, loss=self.loss)
        resume = checkpoint_path(output).is_file()
        training = Training(setup, config, output, machine.compute, resume, Clock(now=process_time))
        result = training.run(ReportConfig(preview_minutes=0.0))
        avatar = result.avatar
        parameters = parameter_count(avatar.field) + parameter_count(avatar.superres)
        remarks = "" if perceptual is not None or not has_term else "trained without the perceptual term: no weights"
        return Fitted(result.progress.step, result.progress.seconds / 60, parameters, remarks)

    def load(self, folder: Path, hand: HandModel, device: torch.device) -> ShotRenderer:
        """Load the avatar's renderer."""
        return Renderer(load_avatar(folder / AVATAR_FILE), hand, device.type)

    def with_samples(self, count: int) -> AvatarRow:
        """Return the same with another number of samples a ray."""
        sampler = replace(self.config.sampler, samples_per_ray=count)
        return replace(self, config=replace(self.config, sampler=sampler))

    def with_loss_of_paper(self, patch_px: int) -> AvatarRow:
        """Return the same trained with the paper's loss, squared error and LPIPS 1 : 1 from the first step.

        What the row leaves out of the loss stays out.
        """
        own, loss = self.loss, replace(_PAPERS_LOSS, perceptual_patch_px=patch_px)
        loss = replace(loss, perceptual_region=own.perceptual_region)
        loss = replace(loss, **{name: 0.0 for name in ("low_l2", "perceptual") if getattr(own, name) == 0})
        return replace(self, loss=loss)

    def _corrections(
        self, capture: Capture, hand: HandModel, output: Path, machine: FittingMachine
    ) -> tuple[Correction, ...]:
        if not self.is_refined:
            return ()
        refined = output.with_suffix(".refined")
        return (refined_poses(capture, hand, RefinementConfig(), refined, machine.device),)


def _row(
    name: str,
    label: str,
    tables: tuple[str, ...],
    notes: str = "",
    change: Callable[[AvatarConfig], AvatarConfig] = lambda config: config,
    loss: LossConfig = FROM_THE_START,
    is_perceptual_needed: bool = False,
) -> AvatarRow:
    """Make a row that differs from the paper's in one thing."""
    return AvatarRow(name, label, tables, notes, change(_PAPER), loss, is_perceptual_needed)


def _field(field: FieldConfig) -> Callable[[AvatarConfig], AvatarConfig]:
    return lambda config: replace(config, field=field)


def _superres(superres: SuperResConfig) -> Callable[[AvatarConfig], AvatarConfig]:
    return lambda config: replace(config, superres=superres)


_NO_HEIGHT = "Shell, opaque core and samples as in every row; density has no prior in the height, which is not known."
_FULL_RAYS = "A ray through every pixel of the image; the alpha term stays."
_NONE = SuperResConfig(kind="none")

AVATAR_ROWS: tuple[AvatarRow, ...] = (
    AvatarRow(
        "default",
        "LiveHand for Blender (default)",
        ("comparison", "misfit"),
        "Our default: feature planes, a light super-resolution, the perceptual term in the last fifth.",
        AvatarConfig(),
        LossConfig(),
    ),
    _row(
        "paper",
        "LiveHand, the paper's networks",
        ("comparison", "canonical", "components", "misfit"),
        "The published sizes (super-resolution with its constant modulation folded in: of 320,906 numbers 296,072 "
        "remain, with alpha) in our units, shell, loss and schedule; 8 samples a ray instead of 16, as in all rows.",
    ),
    _row("no_pose", "uvh without pose", ("canonical",), change=_field(FieldConfig(kind="paper", pose=False))),
    _row("xyz", "xyz", ("canonical",), "Raw metres of the world, 8 x 256. " + _NO_HEIGHT, _field(FieldConfig("xyz"))),
    _row(
        "bones",
        "per-bone xyz",
        ("canonical",),
        "16 x (4 x 96) without pose, which fits the published number of parameters; weights are the skinning's at the "
        "nearest surface point, and bones without weight are not asked, which changes nothing but the time. "
        + _NO_HEIGHT,
        _field(FieldConfig("bones", pose=False)),
    ),
    _row(
        "no_sr",
        "without SR, without perceptual loss",
        ("components",),
        _FULL_RAYS,
        _superres(_NONE),
        _WITHOUT,
    ),
    _row(
        "no_sr_patch",
        "without SR, perceptual loss on patches",
        ("components",),
        _FULL_RAYS
        + " Every term sees one patch of 64 x 64 px on the hand, as in the authors' code; the rays beside it "
        "are rendered all the same, so this row could be cheaper. The perceptual term is at full and half resolution.",
        _superres(_NONE),
        replace(FROM_THE_START, low_l2=0.0, perceptual_region="patch_all"),
        is_perceptual_needed=True,
    ),
    _row(
        "no_sr_full",
        "without SR, perceptual loss on the full image",
        ("components",),
        _FULL_RAYS + " The perceptual term is at full and half resolution.",
        _superres(_NONE),
        replace(FROM_THE_START, low_l2=0.0),
        is_perceptual_needed=True,
    ),
    _row(
        "bilinear",
        "bilinear instead of SR",
        ("components",),
        "Not in the paper: what is learnt, apart from the resolution.",
        _superres(SuperResConfig(kind="bilinear")),
    ),
)

REFINED = AvatarRow(
    "default_refined",
    "LiveHand for Blender, --refine",
    ("misfit",),
    "Poses and shape are corrected in training.",
    AvatarConfig(),
    LossConfig(),
    is_refined=True,
)
