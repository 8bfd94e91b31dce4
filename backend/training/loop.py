"""Fits an avatar to a capture: the main road of training."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..avatars.file import save_avatar
from ..avatars.thumbnail import with_thumbnail
from ..nerf.avatar import Avatar
from ..records.errors import LiveHandError
from .average import WeightAverage
from .checkpoint import Progress, TrainState, checkpoint_path, load_checkpoint, save_checkpoint
from .clock import Clock, Every
from .config import ReportConfig, TrainConfig
from .faults import FaultStreak
from .origin import first_avatar
from .parts import TrainedParts, optimiser_of
from .preview import HeldOutPreview
from .report import TrainingReport
from .schedule import Schedule
from .setup import TrainingResult, TrainingSetup, provenance_of, run_identity
from .step import Machine, Stepper, StepResult
from .views import TrainingViews


def train(
    task: TrainingSetup,
    config: TrainConfig,
    output: Path,
    machine: Machine,
    reporting: ReportConfig,
    resume: bool = False,
) -> TrainingResult:
    """Train an avatar and save it to `output`; `resume` goes on from its checkpoint.

    Raises:
        LiveHandError: the capture or the origin is of another hand, there are no training images, the checkpoint is of
            another run, the batch cannot be shared by the processes, or nothing finite comes of the images.
    """
    training = Training(task, config, output, machine, resume)
    with training.report(reporting) as report:
        while not training.is_over():
            training.step(report)
        return training.finish(report)


class Training:
    """One session of a training; arguments and errors as `train`."""

    def __init__(self, task: TrainingSetup, config: TrainConfig, output: Path, machine: Machine, resume: bool):
        self._task, self._config, self._output, self._machine = task, config, output, machine
        self._avatar = first_avatar(output.stem, task.hand, task.avatar_config, config.seed, task.origin)
        views = _views_of(task, config, machine)
        self._parts = TrainedParts(self._avatar, task.corrections).to(machine.device).train()
        self._average = WeightAverage(self._parts, config.ema_decay)
        optimiser = optimiser_of(self._parts, config, task.corrections)
        self._state = TrainState(self._parts, self._average.module, optimiser)
        self._identity = run_identity(task, config, machine.precision, len(views))
        self._progress = self._saved = self._resumed() if resume else Progress()
        self._schedule, self._clock = Schedule(config), Clock(self._progress.seconds)
        perceptual = task.perceptual.to(machine.device) if task.perceptual is not None else None
        surroundings = (config, machine, self._clock, perceptual, task.corrections)
        self._stepper = Stepper(self._avatar, self._parts, optimiser, views, *surroundings)
        self._streak = FaultStreak(config.max_skipped)
        self._checkpoint_due = Every(60 * config.checkpoint_minutes)

    def is_over(self) -> bool:
        """Whether all steps are taken, or all time is spent."""
        return self._schedule.is_over(self._progress.step, self._progress.seconds)

    def step(self, report: TrainingReport) -> None:
        """Take the next step, tell of it, and save the state when it is time."""
        moment = self._schedule.at(self._progress.step, self._progress.seconds)
        result = self._stepper.take(moment)
        self._average.update(self._parts, moment.step)
        self._advance(result)
        report.step(moment, result, self._look)
        self._streak.note(result.faulty_files)
        if self._progress.step % self._config.checkpoint_every == 0 or self._checkpoint_due.is_due():
            self._save_checkpoint()

    def finish(self, report: TrainingReport) -> TrainingResult:
        """Save the avatar, and the state so that nothing is done again."""
        if not self._schedule.is_over(self._saved.step, self._saved.seconds):
            self._save_checkpoint()
        provenance = provenance_of(self._task, self._config, self._machine.precision, self._progress)
        avatar = replace(self._look(), provenance=provenance)
        if self._machine.processes.is_first:
            for correction in self._task.corrections:
                avatar = correction.finish(avatar)
            avatar = with_thumbnail(avatar, self._task.hand, str(self._machine.device))
            save_avatar(avatar, self._output)
        report.finish(self._progress.step, avatar)
        return TrainingResult(avatar, self._progress, self._clock.data_wait_share, report.held_out)

    def report(self, config: ReportConfig) -> TrainingReport:
        """Of this session; silent in any process but the first."""
        preview = HeldOutPreview(self._task.capture, self._task.hand, self._machine.device, config.preview_views)
        first_step = self._progress.step
        is_first = self._machine.processes.is_first
        return TrainingReport(
            config, self._schedule, self._clock, preview, self._output if is_first else None, first_step
        )

    def _look(self) -> Avatar:
        """The avatar as it is now."""
        return self._average.module.with_networks(self._avatar)

    def _seconds(self) -> float:
        """Spent so far, the same in all processes where it matters."""
        seconds = self._clock.total_s
        if self._config.minutes is None:
            return seconds
        return self._machine.processes.from_first(seconds, self._machine.device)

    def _advance(self, result: StepResult) -> None:
        skipped = self._progress.skipped + bool(result.faulty_files)
        self._progress = Progress(self._progress.step + 1, self._seconds(), skipped)

    def _save_checkpoint(self) -> None:
        if self._machine.processes.is_first:
            save_checkpoint(checkpoint_path(self._output), self._state, self._progress, self._identity)
        self._saved = self._progress

    def _resumed(self) -> Progress:
        path = checkpoint_path(self._output)
        return load_checkpoint(path, self._state, self._identity) if path.is_file() else Progress()


def _views_of(task: TrainingSetup, config: TrainConfig, machine: Machine) -> TrainingViews:
    """The training images that show the hand."""
    if config.batch % machine.processes.count:
        raise LiveHandError(
            f"the images of a step must be shared equally by {machine.processes.count} processes, got {config.batch}; "
            f"give --batch {machine.processes.count} or a multiple of it"
        )
    capture = task.capture
    sampler = task.avatar_config.sampler
    views = TrainingViews(capture, capture.of_split("train"), task.hand, sampler, machine.device, config.seed)
    if not len(views):
        raise LiveHandError(f"capture {capture.folder} must have training images that show the hand, got none")
    return views
