"""What training reports while it runs: a progress bar or lines, metrics, and previews of held-out views."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from statistics import fmean

from tqdm import tqdm

from ..avatars.avatar import Avatar
from .config import ReportConfig
from .metric_writers import JsonLinesLog, MetricWriter, TensorBoardLog
from .preview import HeldOutPreview
from .schedule import Clock, Interval, Schedule, ScheduleState
from .step import StepResult


def log_path(output: Path) -> Path:
    """Return the path of the log of an avatar's training."""
    return output.with_suffix(".log.jsonl")


def preview_path(output: Path) -> Path:
    """Return the path of the latest preview of an avatar in training."""
    return output.with_suffix(".preview.png")


_LINE_EVERY_S = 20.0  # where no bar is seen moving


class TrainingReport:
    """Reports every step. As a context manager it closes the bar and the metric writers at the end.

    Args:
        config: what is reported and how often.
        schedule: of the training.
        clock: of the training.
        preview: the held-out views.
        output: the avatar's file, beside which all files are written; None reports nothing.
        first_step: the step at which this session begins.

    Raises:
        LiveHandError: TensorBoard files are requested but cannot be written.

    Attributes:
        held_out: metrics of the last preview, dB.
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
        self._terms: list[dict[str, float]] = []  # of the steps since the last log entry
        self._rate_factor, self._skipped = 0.0, 0
        self._preview_interval = Interval(60 * config.preview_minutes, clock)
        self._line_interval = Interval(0.0 if sys.stderr.isatty() else _LINE_EVERY_S, clock)
        self._writers = _open_writers(output, config, first_step) if output else []
        self._bar = tqdm(
            total=round(schedule.total),
            initial=int(schedule.done(first_step, clock.total_s)),
            unit="step" if schedule.config.minutes is None else "s",
            desc="train",
            disable=output is None,
        )

    def __enter__(self) -> TrainingReport:
        return self

    def __exit__(self, *error: object) -> None:
        self._bar.close()
        for writer in self._writers:
            writer.close()

    def step(self, state: ScheduleState, result: StepResult, current_avatar: Callable[[], Avatar]) -> None:
        """Report a finished step; `current_avatar` is called only for a preview."""
        step = state.step + 1
        self._rate_factor = state.rate_factor
        self._skipped += bool(result.faulty_files)
        if result.faulty_files:
            self._print(f"step {step} skipped: not finite in {', '.join(result.faulty_files)}")
        else:
            self._terms.append(result.terms)
        self._update_bar(step, result)
        if self._line_interval.is_due():
            self._print_progress(step, result)
        if step % self._config.log_every == 0:
            self._log(step)
        if self._preview_interval.is_due():
            self._write_preview(current_avatar(), step)

    def finish(self, step: int, avatar: Avatar) -> None:
        """Report the end of training after so many steps."""
        if self._terms:
            self._log(step)
        if self._config.preview_minutes and step > self._first_step:
            self._write_preview(avatar, step)

    def _write_preview(self, avatar: Avatar, step: int) -> None:
        result = self._preview.render(avatar) if self._output else None
        if self._output is None or result is None:
            return
        self.held_out = result.metrics
        result.save(preview_path(self._output))
        for writer in self._writers:
            writer.write_scalars(step, {f"held_out/{name}": value for name, value in result.metrics.items()})
            writer.write_preview(step, result.sheet)
        psnr = "{psnr_full:.2f} dB full, {psnr_hand:.2f} dB hand".format(**result.metrics)
        self._print(f"step {step}: held-out PSNR {psnr}; waited for data {self._clock.data_wait_share:.1%} of the time")

    def _log(self, step: int) -> None:
        """Write the mean terms of the steps since the last entry, and the pace."""
        names = dict.fromkeys(name for terms in self._terms for name in terms)
        means = {f"loss/{name}": fmean(terms[name] for terms in self._terms if name in terms) for name in names}
        self._terms = []
        step_s = self._clock.session_s / (step - self._first_step)
        scalars = means | {
            "rate": self._rate_factor,
            "time/total_s": self._clock.total_s,
            "time/step_s": step_s,
            "time/eta_s": self._schedule.remaining_s(step, self._clock.total_s, step_s),
            "time/data_wait_share": self._clock.data_wait_share,
            "skipped": float(self._skipped),
        }
        for writer in self._writers:
            writer.write_scalars(step, scalars)

    def _update_bar(self, step: int, result: StepResult) -> None:
        terms = ", ".join(f"{name} {value:.4f}" for name, value in result.terms.items() if name != "total")
        loss = f"loss {result.terms['total']:.4f}" + (f" ({terms})" if terms else "")
        count = "" if self._schedule.config.minutes is None else f"step {step}, "
        skipped = f", {self._skipped} skipped" if self._skipped else ""
        self._bar.set_postfix_str(count + loss + skipped, refresh=False)
        self._bar.update(int(self._schedule.done(step, self._clock.total_s)) - self._bar.n)

    def _print_progress(self, step: int, result: StepResult) -> None:
        """Print a line of progress, for logs and pipes."""
        total_s = self._clock.total_s
        share = self._schedule.done(step, total_s) / self._schedule.total
        step_s = self._clock.session_s / (step - self._first_step)
        left_minutes = self._schedule.remaining_s(step, total_s, step_s) / 60
        self._print(
            f"step {step}, {share:.0%}, loss {result.terms['total']:.4f}, about {left_minutes:.1f} minutes left"
        )

    def _print(self, line: str) -> None:
        if self._output:
            self._bar.write(line, file=sys.stderr)


def _open_writers(output: Path, config: ReportConfig, first_step: int) -> list[MetricWriter]:
    boards = [TensorBoardLog(config.tensorboard, first_step)] if config.tensorboard else []
    return [JsonLinesLog(log_path(output), first_step), *boards]
