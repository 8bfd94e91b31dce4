"""What a run tells while it goes on: events, and what they add up to for each shot."""

from __future__ import annotations

import statistics
from collections import Counter
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

FrameState = Literal["written", "skipped", "left"]
_RANK: dict[FrameState, int] = {"left": 0, "skipped": 1, "written": 2}


@dataclass(frozen=True)
class ShotOpened:
    """A shot is open; `frames` are asked for."""

    folder: str
    frames: int


@dataclass(frozen=True)
class FrameProgress:
    """One frame is done with: the `number`th of `count`.

    Attributes:
        frame: its number in the scene.
        number: its place in the list, from 1.
        count: of the list.
        state: `written` now, `skipped` because it was there, or `left` to another process that is rendering it.
        seconds: it took; None unless it was written.
    """

    frame: int
    number: int
    count: int
    state: FrameState
    seconds: float | None = None

    def __str__(self):
        done = f"frame {self.frame} ({self.number}/{self.count})"
        told = {"skipped": "already there", "left": "left to another process"}
        return f"{done}: {self.seconds:.2f} s" if self.seconds is not None else f"{done}: {told[self.state]}"


@dataclass(frozen=True)
class Warned:
    """Something is wrong that does not stop the run."""

    message: str


@dataclass(frozen=True)
class Failed:
    """The shot cannot be rendered (any further)."""

    message: str


Event = ShotOpened | FrameProgress | Warned | Failed
Tell = Callable[[Event], None]
EVENT_NAMES: dict[str, type[Event]] = {"shot": ShotOpened, "frame": FrameProgress, "warning": Warned, "error": Failed}
_NAME_OF = {kind: name for name, kind in EVENT_NAMES.items()}


def to_record(shot: Path, event: Event) -> dict[str, Any]:
    """An event as one JSON object."""
    record = asdict(event)
    if record.get("seconds") is not None:
        record["seconds"] = round(record["seconds"], 3)
    return {"event": _NAME_OF[type(event)], "file": str(shot), **record}


def from_record(record: dict[str, Any]) -> tuple[Path, Event]:
    """What `to_record` was given."""
    values = {name: value for name, value in record.items() if name not in ("event", "file")}
    return Path(record["file"]), EVENT_NAMES[record["event"]](**values)


@dataclass
class ShotTally:
    """What one shot's events add up to, from however many processes they come.

    Attributes:
        folder: of its frames.
        count: how many frames are asked for; None until it was opened.
        states: frame -> the best that any process told of it.
        warnings: each message once.
        errors: likewise.
    """

    folder: Path
    count: int | None = None
    states: dict[int, FrameState] = field(default_factory=dict)
    warnings: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)
    _seconds: list[float] = field(default_factory=list)

    def add(self, event: Event) -> bool:
        """Take an event in; returns whether it is news."""
        match event:
            case ShotOpened(frames=count):
                is_news, self.count = self.count is None, count
            case FrameProgress(frame=frame, state=state, seconds=seconds):
                before = self.states.get(frame)
                is_news = before is None or _RANK[state] > _RANK[before]
                if is_news:
                    self.states[frame] = state
                if seconds is not None:
                    self._seconds.append(seconds)
            case Warned(message=message) | Failed(message=message):
                known = self.warnings if isinstance(event, Warned) else self.errors
                is_news = message not in known
                known += [message] * is_news
        return is_news

    def number_of(self, state: FrameState) -> int:
        """How many frames ended so."""
        return Counter(self.states.values())[state]

    def missing(self, with_left: bool) -> str | None:
        """Which frames nobody has done, in words; `with_left`: those left to another process among them."""
        if self.count is None:
            return "all frames are"
        done = len(self.states) - (self.number_of("left") if with_left else 0)
        return f"{self.count - done} of {self.count} frames are" if done < self.count else None

    @property
    def seconds_per_frame(self) -> float:
        """Median over the frames written; 0 if none was."""
        return statistics.median(self._seconds) if self._seconds else 0.0

    def result(self, shot: Path) -> dict[str, Any]:
        """As the last line of `--json` has it."""
        return {
            "file": str(shot),
            "folder": str(self.folder),
            "frames": self.count or 0,
            **{state: self.number_of(state) for state in ("written", "skipped", "left")},
            "seconds_per_frame": round(self.seconds_per_frame, 3),
            "error": "; ".join(self.errors) or None,
        }
