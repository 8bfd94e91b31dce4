"""The output of `livehand render`: progress and failures as they happen, and the result."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from ..system.command import say, warn
from .progress import Event, EventHandler, Failed, FrameProgress, ShotTally, Warned, to_record

_TOTALS = ("frames", "written", "skipped", "left", "of_other_versions")


class RunReport:
    """Prints the events of all shots, as text or one JSON object a line, and totals them.

    Args:
        folders: shot -> folder of its frames.
        output: the folder of all shots.
        as_json: print JSON.
        is_quiet: do not repeat warnings and errors on stderr, because a parent process reads the JSON and does.
    """

    def __init__(self, folders: Mapping[Path, Path], output: Path, as_json: bool, is_quiet: bool = False):
        self.tallies = {shot: ShotTally(folder) for shot, folder in folders.items()}
        self._output, self._as_json, self._is_quiet = output, as_json, is_quiet

    def handler(self, shot: Path) -> EventHandler:
        """Return the event handler of one shot."""
        return partial(self.add, shot)

    def add(self, shot: Path, event: Event) -> None:
        """Count an event, and print it if it says something new."""
        if self.tallies[shot].add(event):
            self._show(shot, event)

    def _show(self, shot: Path, event: Event) -> None:
        if self._as_json:
            say(json.dumps(to_record(shot, event)))
        elif isinstance(event, FrameProgress):
            say(f"{shot.stem} {event}" if len(self.tallies) > 1 else str(event))
        if isinstance(event, Warned | Failed) and not self._is_quiet:
            kind = "warning: " if isinstance(event, Warned) else ""
            warn(f"livehand render: {shot}: {kind}{event.message}")

    def compare_versions(self) -> bool:
        """Warn of frames that stay and are of another version; returns whether there are any. The last event."""
        for shot, tally in self.tallies.items():
            if tally.others:
                self.add(shot, Warned(tally.others))
        return any(tally.others for tally in self.tallies.values())

    @property
    def has_failed(self) -> bool:
        """Whether any shot has failed."""
        return any(tally.errors for tally in self.tallies.values())

    def result(self) -> dict[str, Any]:
        """Return the totals, and those of each shot."""
        files = [tally.result(shot) for shot, tally in self.tallies.items()]
        seconds = [file["seconds_per_frame"] for file in files if file["written"]]
        totals = {key: sum(file[key] for file in files) for key in _TOTALS}
        return {
            "folder": str(self._output),
            **totals,
            "seconds_per_frame": median(seconds) if seconds else 0.0,
            "files": files,
            "summary": self._summary(files),
        }

    def _summary(self, files: list[dict[str, Any]]) -> str:
        lines = [_line(file) for file in files if len(files) > 1 or file["written"] or not file["error"]]
        failed = [file["file"] for file in files if file["error"]]
        if failed and len(files) > 1:
            lines.append(f"failed: {', '.join(failed)}")
        return "\n".join(lines)


def _line(file: Mapping[str, Any]) -> str:
    left = f", {file['left']} left to other processes" if file["left"] else ""
    frames = file["written"] + file["skipped"] + file["left"]
    done = f"{frames} frames ({file['written']} written, {file['skipped']} already there{left})"
    return f"{file['folder']}: {done}, {file['seconds_per_frame']:.2f} s/frame" + (", failed" if file["error"] else "")
