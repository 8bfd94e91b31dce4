"""Trains an avatar on a capture."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..avatars.avatar import Avatar
from ..avatars.file import save_avatar
from ..capture.joined import first_person
from ..records.errors import LiveHandError
from ..render.thumbnail import with_thumbnail
from .checkpoint import Progress, TrainState, checkpoint_path, load_checkpoint, save_checkpoint
from .config import ReportConfig, TrainConfig
from .lit_views import LitTrainingViews
from .parts import TrainedParts, WeightAverage, optimiser_of
from .preview import HeldOutPreview
from .processes import ComputeSetup
from .report import TrainingReport
from .schedule import Clock, Interval, Schedule
from .setup import TrainingResult, TrainingSetup, initial_avatar, provenance_of, run_identity
from .step import SkippedSteps, Stepper, StepResult
from .views import TrainingViews


def train(
    setup: TrainingSetup,
    config: TrainConfig,
    output: Path,
    compute: ComputeSetup,
    reporting: ReportConfig,
    resume: bool = False,
) -> TrainingResult:
    """Train an avatar and save it to `output`; `resume` continues from its checkpoint if there is one.

    Raises:
        LiveHandError: the capture or the avatar to fine-tune is of another hand, there are no training images, the
            checkpoint is of another run, the batch cannot be shared by the processes, or losses are never finite.
    """
    return Training(setup, config, output, compute, resume).run(reporting)


class Training:
    """One session of a training; arguments and errors as `train`, and a clock for tests."""

    def __init__(
        self,
        setup: TrainingSetup,
        config: TrainConfig,
        output: Path,
        compute: ComputeSetup,
        resume: bool = False,
        clock: Clock | None = None,
    ):
        self._setup, self._config, self._output, self._compute = setup, config, output, compute
        self._clock = clock or Clock()
        self._avatar = initial_avatar(output.stem, setup, config.seed)
        views = _training_views(setup, config, compute)
        self._parts = TrainedParts(self._avatar, setup.corrections).to(compute.device).train()
        if setup.is_code_alone:
            self._parts.freeze_all_but_codes()
        self._average = WeightAverage(self._parts, config.ema_decay)
        optimiser = optimiser_of(self._parts, config, setup.corrections)
        perceptual = setup.perceptual.to(compute.device) if setup.perceptual is not None else None
        self._stepper = Stepper(
            self._avatar, self._parts, optimiser, views, config, compute, self._clock, perceptual, setup.corrections
        )
        self._schedule, self._skipped_steps = Schedule(config), SkippedSteps(config.max_skipped)
        self._checkpoint_interval = Interval(60 * config.checkpoint_minutes, self._clock)
        self._state = TrainState(self._parts, self._average.module, optimiser)
        self._identity = run_identity(setup, config, compute.precision, len(views))
        self._progress = self._saved = self._resumed() if resume else Progress()
        self._clock.spent_s = self._progress.seconds

    def run(self, reporting: ReportConfig) -> TrainingResult:
        """Do all remaining steps and save the avatar."""
        with self._report(reporting) as report:
            while not self._is_over():
                self._step(report)
            report.finish(self._progress.step, self._current_avatar())
            self._finish_checkpoint()
            avatar = self._finished_avatar()
        return TrainingResult(avatar, self._progress, self._clock.data_wait_share, report.held_out)

    def _step(self, report: TrainingReport) -> None:
        """Do the next step, report it, and save a checkpoint if one is due."""
        state = self._schedule.at(self._progress.step, self._progress.seconds)
        result = self._stepper.train_step(state)
        self._average.update(self._parts, state.step)
        self._advance(result)
        report.step(state, result, self._current_avatar)
        self._skipped_steps.update(result.faulty_files)
        if self._is_checkpoint_due() and not self._is_over():
            self._save_checkpoint()

    def _is_checkpoint_due(self) -> bool:
        return self._progress.step % self._config.checkpoint_every == 0 or self._checkpoint_interval.is_due()

    def _is_over(self) -> bool:
        return self._schedule.is_over(self._progress.step, self._progress.seconds)

    def _advance(self, result: StepResult) -> None:
        seconds = self._clock.total_s
        if self._config.minutes is not None:  # all processes must agree on when training ends
            seconds = self._compute.processes.from_first(seconds, self._compute.device)
        skipped = self._progress.skipped + bool(result.faulty_files)
        self._progress = Progress(self._progress.step + 1, seconds, skipped)

    def _current_avatar(self) -> Avatar:
        """Return the avatar so far with its provenance, by which a renderer knows whose skin it shows."""
        provenance = provenance_of(self._setup, self._config, self._compute.precision, self._progress)
        return replace(self._average.module.with_networks(self._avatar), provenance=provenance)

    def _finished_avatar(self) -> Avatar:
        """Return the avatar, saved by the first process."""
        avatar = self._current_avatar()
        if self._compute.processes.is_first:
            for correction in self._setup.corrections:
                avatar = correction.finish(avatar)
            avatar = with_thumbnail(avatar, self._setup.hand, str(self._compute.device))
            save_avatar(avatar, self._output)
        return avatar

    def _finish_checkpoint(self) -> None:
        """Save the final state, so that a resumed training has nothing left to do; all has been reported before."""
        if not self._schedule.is_over(self._saved.step, self._saved.seconds):
            self._save_checkpoint()

    def _save_checkpoint(self) -> None:
        if self._compute.processes.is_first:
            save_checkpoint(checkpoint_path(self._output), self._state, self._progress, self._identity)
        self._saved = self._progress

    def _resumed(self) -> Progress:
        path = checkpoint_path(self._output)
        return load_checkpoint(path, self._state, self._identity) if path.is_file() else Progress()

    def _report(self, config: ReportConfig) -> TrainingReport:
        """Make the report of this session, which only the first process writes."""
        output = self._output if self._compute.processes.is_first else None
        preview = HeldOutPreview(
            first_person(self._setup.capture), self._setup.hand, self._compute.device, config.preview_views
        )
        return TrainingReport(config, self._schedule, self._clock, preview, output, self._progress.step)


def _training_views(setup: TrainingSetup, config: TrainConfig, compute: ComputeSetup) -> TrainingViews:
    """List the training images that show the hand."""
    count = compute.processes.count
    if config.batch % count:
        raise LiveHandError(
            f"the images of a step must be shared equally by {count} processes, got {config.batch}; "
            f"give --batch {count} or a multiple of it"
        )
    capture, sampler = setup.capture, setup.avatar_config.sampler
    arguments = capture, capture.of_split("train"), setup.hand, sampler, compute.device, config.seed
    if setup.avatar_config.field.light == "linear":
        views = LitTrainingViews(*arguments)
    else:
        views = TrainingViews(*arguments, setup.avatar_config.superres.scale)
    if not len(views):
        raise LiveHandError(f"capture {capture.folder} must have training images that show the hand, got none")
    return views
