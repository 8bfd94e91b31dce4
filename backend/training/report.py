"""What a training tells while it runs: a progress bar, journals, and now and then a preview of held-out views."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

from tqdm import tqdm

from ..nerf.avatar import Avatar
from .clock import Clock, Every
from .config import ReportConfig
from .metric_writers import Journal, LogFile, TensorBoard
from .preview import HeldOutPreview
from .schedule import Schedule, ScheduleState
from .step import StepResult


def log_path(output: Path) -> Path:
    """Where the log of an avatar's training lies."""
    return output.with_suffix(".log.jsonl")


def preview_path(output: Path) -> Path:
    """Where the latest preview lies."""
    return output.with_suffix(".preview.png")


class TrainingReport:
    """Told of every step. A context: it ends the bar and closes the journals.

    Args:
        config: how often.
        schedule: of the training.
        clock: of the training.
        preview: the held-out views.
        output: the avatar's file, beside which everything lies; None: nothing is told.
        first_step: where this session begins.

    Raises:
        LiveHandError: TensorBoard is asked for and cannot be written.

    Attributes:
        held_out: figures of the last preview, dB.
    """

    def __init__(
        self,
        config: ReportConfig,
        schedule: Schedule,
        clock: Clock,
        preview: HeldOutPreview,
        output: Path | None,
        first_step: int,
    ):
        self._config, self._schedule, self._clock = config, schedule, clock
        self._preview, self._output, self._first_step = preview, output, first_step
        self.held_out: dict[str, float] = {}
        self._since: list[dict[str, float]] = []
        self._rate = 0.0
        self._skipped = 0
        self._preview_due = Every(60 * config.preview_minutes)
        self._journals = _open_journals(output, config, first_step) if output else []
        self._bar = self._new_bar()

    def __enter__(self) -> TrainingReport:
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.close()
        for journal in self._journals:
            journal.close()

    def step(self, moment: ScheduleState, result: StepResult, look: Callable[[], Avatar]) -> None:
        """A step was taken; `look` gives the avatar as it is now."""
        self._rate = moment.rate
        self._skipped += bool(result.faulty_files)
        if result.faulty_files:
            self._say(f"step {moment.step + 1} skipped: not finite in {', '.join(result.faulty_files)}")
        else:
            self._since.append(result.terms)
        self._move_bar(moment.step + 1, result)
        if (moment.step + 1) % self._config.log_every == 0:
            self._log(moment.step + 1)
        if self._preview_due.is_due():
            self._look_at(look(), moment.step + 1)

    def finish(self, step: int, avatar: Avatar) -> None:
        """Training is over after so many steps."""
        if self._since:
            self._log(step)
        if self._config.preview_minutes and step > self._first_step:
            self._look_at(avatar, step)

    def _look_at(self, avatar: Avatar, step: int) -> None:
        """Render the held-out views."""
        shown = self._preview.of(avatar) if self._output else None
        if self._output is None or shown is None:
            return
        self.held_out = shown.figures
        shown.save(preview_path(self._output))
        for journal in self._journals:
            journal.figures(step, {f"held_out/{name}": value for name, value in shown.figures.items()})
            journal.picture(step, shown.sheet)
        psnr = "{psnr_full:.2f} dB full, {psnr_hand:.2f} dB hand".format(**shown.figures)
        self._say(f"step {step}: held-out PSNR {psnr}; waited for data {self._clock.data_wait_share:.1%} of the time")

    def _log(self, step: int) -> None:
        """The means of the steps since the last time."""
        names = list(dict.fromkeys(name for terms in self._since for name in terms))
        values = {name: [terms[name] for terms in self._since if name in terms] for name in names}
        self._since = []
        pace_s = self._clock.session_s / (step - self._first_step)
        figures = {f"loss/{name}": sum(seen) / len(seen) for name, seen in values.items()} | {
            "rate": self._rate,
            "time/total_s": self._clock.total_s,
            "time/step_s": pace_s,
            "time/eta_s": self._schedule.eta_s(step, self._clock.total_s, pace_s),
            "time/data_wait_share": self._clock.data_wait_share,
            "skipped": float(self._skipped),
        }
        for journal in self._journals:
            journal.figures(step, figures)

    def _new_bar(self) -> tqdm:
        """Counts steps, or seconds of a budget: what is left is its ETA."""
        config = self._schedule.config
        done = self._schedule.done(self._first_step, self._clock.total_s)
        unit = "step" if config.minutes is None else "s"
        total, is_silent = round(self._schedule.whole), self._output is None
        return tqdm(total=total, initial=int(done), unit=unit, desc="train", disable=is_silent)

    def _move_bar(self, step: int, result: StepResult) -> None:
        done = int(self._schedule.done(step, self._clock.total_s))
        named = [f"{name} {value:.4f}" for name, value in result.terms.items() if name != "total"]
        loss = f"loss {result.terms['total']:.4f}" + (f" ({', '.join(named)})" if named else "")
        count = "" if self._schedule.config.minutes is None else f"step {step}, "
        skipped = f", {self._skipped} skipped" if self._skipped else ""
        self._bar.set_postfix_str(count + loss + skipped, refresh=False)
        self._bar.update(done - self._bar.n)

    def _say(self, line: str) -> None:
        if self._output:
            self._bar.write(line, file=sys.stderr)


def _open_journals(output: Path, config: ReportConfig, first_step: int) -> list[Journal]:
    boards = [TensorBoard(config.tensorboard, first_step)] if config.tensorboard else []
    return [LogFile(log_path(output), first_step), *boards]
