"""The events of a running render, and their totals for each shot."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from .shot_version import others_message, others_text

FrameState = Literal["written", "skipped", "left"]
_RANK: dict[FrameState, int] = {"left": 0, "skipped": 1, "written": 2}


@dataclass(frozen=True)
class ShotOpened:
    """A shot was opened; `frames` frames of it are to be rendered. `version` is the digest of its `ShotVersion`."""

    folder: str
    frames: int
    version: str | None = None


@dataclass(frozen=True)
class FrameProgress:
    """One frame is finished with: the `number`th of `count`.

    Attributes:
        frame: its number in the scene.
        number: its place in the list, from 1.
        count: of the list.
        state: `written` now, `skipped` because it existed, or `left` for now to another process that is rendering it.
        seconds: the time it took; None unless it was written.
        differs: in what its files that stay differ from what would be rendered now; see `ShotVersion.differences`.
    """

    frame: int
    number: int
    count: int
    state: FrameState
    seconds: float | None = None
    differs: tuple[str, ...] = ()

    def __str__(self):
        states = {"skipped": "already there", "left": "waiting for another process"}
        outcome = states[self.state] if self.seconds is None else f"{self.seconds:.2f} s"
        other = f", {others_text(self.differs)}" if self.differs else ""
        return f"frame {self.frame} ({self.number}/{self.count}): {outcome}{other}"


@dataclass(frozen=True)
class Warned:
    """A problem that does not stop the run."""

    message: str


@dataclass(frozen=True)
class Failed:
    """The shot cannot be rendered, or not to its end."""

    message: str


Event = ShotOpened | FrameProgress | Warned | Failed
EventHandler = Callable[[Event], None]
EVENT_NAMES: dict[str, type[Event]] = {"shot": ShotOpened, "frame": FrameProgress, "warning": Warned, "error": Failed}
_NAME_OF = {kind: name for name, kind in EVENT_NAMES.items()}


def to_record(shot: Path, event: Event) -> dict[str, Any]:
    """Turn an event into one JSON object; what differs is left out where nothing does."""
    record = asdict(event)
    if not record.get("differs", True):
        del record["differs"]
    if record.get("seconds") is not None:
        record["seconds"] = round(record["seconds"], 3)
    return {"event": _NAME_OF[type(event)], "file": str(shot), **record}


def from_record(record: dict[str, Any]) -> tuple[Path, Event]:
    """Return the arguments that `to_record` was given."""
    values = {name: value for name, value in record.items() if name not in ("event", "file")}
    if "differs" in values:
        values["differs"] = tuple(values["differs"])
    return Path(record["file"]), EVENT_NAMES[record["event"]](**values)


@dataclass
class ShotTally:
    """The totals of one shot's events, from any number of processes.

    Attributes:
        folder: of its frames.
        count: of the frames to render; None until the shot is opened.
        states: frame -> the best state that any process reported.
        differences: frame -> in what its files that stay differ from what would be rendered now.
        versions: the digests of the shot's versions that were opened.
        warnings: each message once.
        errors: each message once.
    """

    folder: Path
    count: int | None = None
    states: dict[int, FrameState] = field(default_factory=dict)
    differences: dict[int, tuple[str, ...]] = field(default_factory=dict)
    versions: set[str] = field(default_factory=set)
    warnings: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    _seconds: list[float] = field(default_factory=list)

    def add(self, event: Event) -> bool:
        """Count an event; returns whether it says something new."""
        match event:
            case ShotOpened(frames=count, version=version):
                is_new, self.count = self.count is None, count
                self.versions |= {version} if version else set()
            case FrameProgress(frame=frame, state=state, seconds=seconds, differs=differs):
                before = self.states.get(frame)
                is_new = before is None or _RANK[state] > _RANK[before]
                if is_new:
                    self.states[frame], self.differences[frame] = state, differs
                if seconds is not None:
                    self._seconds.append(seconds)
            case Warned(message=message) | Failed(message=message):
                known = self.warnings if isinstance(event, Warned) else self.errors
                is_new = message not in known
                known += [message] * is_new
        return is_new

    def number_of(self, state: FrameState) -> int:
        """Count the frames that ended in this state."""
        return Counter(self.states.values())[state]

    @property
    def others(self) -> str | None:
        """The report on frames that stay and are of another version; None if there are none."""
        return others_message(self.differences.values())

    def missing(self, with_left: bool) -> str | None:
        """Say how many frames no process has finished, including those left to another one if `with_left`."""
        if self.count is None:
            return "all frames are"
        done = len(self.states) - (self.number_of("left") if with_left else 0)
        return f"{self.count - done} of {self.count} frames are" if done < self.count else None

    @property
    def seconds_per_frame(self) -> float:
        """Median over the written frames; 0 if there are none."""
        return statistics.median(self._seconds) if self._seconds else 0.0

    def result(self, shot: Path) -> dict[str, Any]:
        """Return the shot's entry in the last line of `--json`."""
        return {
            "file": str(shot),
            "folder": str(self.folder),
            "frames": self.count or 0,
            **{state: self.number_of(state) for state in ("written", "skipped", "left")},
            "seconds_per_frame": round(self.seconds_per_frame, 3),
            "of_other_versions": sum(map(bool, self.differences.values())),
            "error": "; ".join(self.errors) or None,
        }
