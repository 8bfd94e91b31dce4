"""Fits and measures the rows one after another, each in a folder of its own, and writes the tables after each.

A row's folder holds `settings.json` from its beginning, and last `row.json`: a row that has it is done, one that has
only the first goes on from its checkpoint. Other settings than those of the folder are refused.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from ...capture.capture import Capture, Split
from ...evaluation.report import Summary, scores_csv, write_text
from ...hand.model import HandModel
from ...records.errors import LiveHandError
from ..baselines.method import Budget, Fitted, FittingMachine
from .grid import load_pictures, save_grids, save_pictures
from .measures import Measured, Measures, held_out_views
from .misfit import Misfitting
from .page import Line, Page, Table
from .rows import TABLES, Row
from .speed import SpeedPlan, measure_speed

ROW, SETTINGS, SPEED, PICTURES = "row.json", "settings.json", "speed.json", "pictures.npz"


@dataclass(frozen=True)
class ComparisonPlan:
    """What is compared, and how.

    Attributes:
        rows: that stand in the tables once they are done, in this order.
        wanted: names of those to fit now, of which cheap ones come first.
        budget: of each fit.
        splits: to measure.
        max_images: of each split; None: all.
        speed: None: nothing is timed.
        redo: names of rows to begin again.
        facts: for the page: machine, command.
    """

    rows: tuple[Row, ...]
    wanted: tuple[str, ...]
    budget: Budget = field(default_factory=Budget)
    splits: tuple[Split, ...] = ("novel_pose", "test")
    max_images: int | None = 16
    speed: SpeedPlan | None = field(default_factory=SpeedPlan)
    redo: tuple[str, ...] = ()
    facts: tuple[tuple[str, str], ...] = ()


class Comparison:
    """One comparison in one folder.

    Args:
        plan: of the comparison.
        capture: with true poses, not lit.
        hand: of the capture.
        folder: of all results.
        machine: to fit on.
        measures: of the fitted methods.
        say: gets a line before each row.

    Raises:
        LiveHandError: the capture has lights, or no views of the splits.
    """

    def __init__(
        self,
        plan: ComparisonPlan,
        capture: Capture,
        hand: HandModel,
        folder: Path,
        machine: FittingMachine,
        measures: Measures,
        say: Callable[[str], None] = lambda line: None,
    ):
        if capture.is_lit:
            raise LiveHandError(
                f"the paper's methods have their light baked in, capture {capture.folder} has lights; "
                "compare on one without --lights varied"
            )
        self._plan, self._capture, self._hand, self._folder = plan, capture, hand, folder
        self._machine, self._measures, self._say = machine, measures, say
        if not held_out_views(capture, plan.splits, plan.max_images):
            raise LiveHandError(f"capture {capture.folder} must have views of {', '.join(plan.splits)}, got none")
        self._rows = plan.rows
        self._wanted = sorted((row for row in plan.rows if row.name in plan.wanted), key=self._cost)
        self._remarks: list[str] = []

    def run(self) -> Page:
        """Do what is left, and write the tables after each row; a row that cannot be fitted is remarked upon."""
        self._check_settings()
        todo = [row for row in self._wanted if not self._is_done(row)]
        for number, row in enumerate(todo):
            left = sum(self._cost(later) for later in todo[number:])
            self._say(f"[{number + 1}/{len(todo)}] {row.name}: about {self._cost(row):.0f} of {left:.0f} core-minutes")
            self._do(row)
            self._write()
        self._time()
        return self._write()

    @property
    def remarks(self) -> list[str]:
        """Why rows are missing."""
        return self._remarks

    def folder_of(self, row: Row) -> Path:
        """Name the row's folder."""
        return self._folder / "rows" / row.name

    def _cost(self, row: Row) -> float:
        return row.core_minutes(self._plan.budget, self._capture)

    def _do(self, row: Row) -> None:
        folder, method = self.folder_of(row), row.method
        write_text(_text(self._settings(row)), folder / SETTINGS)
        case = self._case(row)
        try:
            fitted = method.fit(case.training, case.hand, self._plan.budget, folder, self._machine)
            renderer = method.load(folder, case.hand, self._machine.device)
        except LiveHandError as error:
            self._remarks.append(f"row `{row.name}` is missing: {error}")
            return
        measured = {
            arm: self._measures.of_renderer(
                renderer, capture, held_out_views(capture, self._plan.splits, self._plan.max_images)
            )
            for arm, capture in case.arms.items()
        }
        self._save(row, case, fitted, measured)

    def _case(self, row: Row) -> Misfitting:
        if row.misfit is None:
            return Misfitting(self._capture, {"": self._capture}, self._hand, 0.0)
        return row.misfit.of(self._capture, self._hand, self._machine.seed)

    def _save(self, row: Row, case: Misfitting, fitted: Fitted, measured: dict[str, Measured]) -> None:
        folder = self.folder_of(row)
        for arm, found in measured.items():
            write_text(scores_csv(found.scores), folder / f"scores{'_' + arm if arm else ''}.csv")
        save_pictures(next(iter(measured.values())).pictures, folder / PICTURES)
        summaries = {arm: found.summaries for arm, found in measured.items()}
        write_text(_text(summaries), folder / "summary.json")
        document = {
            "digest": _digest(self._settings(row)),
            "fitted": fitted._asdict(),
            "vertex_mm": round(case.vertex_mm, 4),
            "summaries": summaries,
        }
        write_text(_text(document), folder / ROW)

    def _settings(self, row: Row) -> dict[str, Any]:
        """Collect what determines a row's figures."""
        plan, method = self._plan, row.method
        views = held_out_views(self._capture, plan.splits, plan.max_images)
        return {
            "row": row.name,
            "version": method.version,
            "method": repr(method) if hasattr(method, "__dataclass_fields__") else type(method).__name__,
            "budget": asdict(plan.budget),
            "seed": self._machine.seed,
            "precision": self._machine.compute.precision,
            "is_inference_only": self._machine.is_inference_only,
            "has_perceptual": self._machine.perceptual is not None,
            "capture": self._capture.provenance,
            "training_images": len(self._capture.of_split("train")),
            "views": [view.file for view in views],
            "weights": list(self._measures.names),
        }

    def _check_settings(self) -> None:
        """Begin rows of `redo` again; refuse rows of other settings before anything is computed."""
        for row in self._wanted:
            folder, path = self.folder_of(row), self.folder_of(row) / SETTINGS
            if {row.name, row.method.name} & set(self._plan.redo) and folder.is_dir():
                shutil.rmtree(folder)
            if not path.is_file():
                continue
            settings, known = json.loads(_text(self._settings(row))), _read(path)
            other = [key for key in settings if settings[key] != known.get(key)]
            if other:
                raise LiveHandError(
                    f"row '{row.name}' in {folder} was made with another {', '.join(other)}; repeat its settings, "
                    f"begin it again with --redo {row.name}, or choose another folder with -o"
                )

    def _is_done(self, row: Row) -> bool:
        path = self.folder_of(row) / ROW
        return path.is_file() and _read(path).get("digest") == _digest(self._settings(row))

    def _time(self) -> None:
        """Time all rows together, unless just these have been timed together before."""
        rows = [row for row in self._rows if row.misfit is None and self._is_done(row)]
        if self._plan.speed is None or not rows:
            return
        group = _digest([*sorted(_digest(self._settings(row)) for row in rows), asdict(self._plan.speed)])
        if all(_read(self.folder_of(row) / SPEED).get("group") == group for row in rows):
            return
        self._say(f"timing {len(rows)} rows in turns")
        device = self._machine.device
        renderers = {row.name: row.method.load(self.folder_of(row), self._hand, device) for row in rows}
        for name, facts in measure_speed(renderers, self._hand, self._plan.speed, device).items():
            write_text(_text({"group": group, **facts}), self._folder / "rows" / name / SPEED)

    def _write(self) -> Page:
        """Write tables and grids of what is done."""
        done = [row for row in self._rows if self._is_done(row)]
        tables = [table for key in TABLES for table in self._tables(key, [row for row in done if key in row.tables])]
        page = Page(tuple(tables), dict(self._facts()), tuple(self._remarks))
        page.save(self._folder)
        plain = [row for row in done if row.misfit is None]
        save_grids({row.label: load_pictures(self.folder_of(row) / PICTURES) for row in plain}, self._folder)
        return page

    def _facts(self) -> list[tuple[str, str]]:
        plan = self._plan
        budget = plan.budget.core_minutes
        spent = f"{plan.budget.steps} steps each" if budget is None else f"{budget:g} core-minutes each"
        weights = ", ".join(self._measures.names) or "none"
        images = str(len(self._capture.of_split("train")))
        return [
            ("capture", self._capture.folder.name),
            ("training images", images),
            ("budget", spent + "; steps and core-minutes taken are in the tables"),
            ("seed", str(self._machine.seed)),
            ("weights of perceptual figures", weights),
            *plan.facts,
        ]

    def _tables(self, key: str, rows: Sequence[Row]) -> list[Table]:
        """Make one table a split, and of the misfit one an arm too."""
        found: dict[str, list[Line]] = {}
        for row in rows:
            record = _read(self.folder_of(row) / ROW)
            for arm, summaries in record["summaries"].items():
                for split, summary in summaries.items():
                    name = f"{split}, arm {arm}" if arm else split
                    found.setdefault(name, []).append(self._line(row, record, summary))
        if key == "misfit":
            found = {name: _with_gaps(lines) for name, lines in found.items()}
        return [Table(key, name, tuple(lines)) for name, lines in found.items()]

    def _line(self, row: Row, record: dict[str, Any], summary: Summary) -> Line:
        fitted, speed = record["fitted"], _read(self.folder_of(row) / SPEED)
        figures = {**summary, "parameters_m": fitted["parameters"] / 1e6, "steps": fitted["steps"]}
        figures |= {"core_minutes": fitted["core_minutes"]}
        figures |= {name: speed[name] for name in ("ms", "ms_p10", "ms_p90", "core_s") if name in speed}
        if row.misfit is not None:
            figures["vertex_mm"] = record["vertex_mm"]
        notes = " ".join(text for text in (row.method.notes, fitted["remarks"]) if text)
        return Line(row.name, row.label, figures, notes)


def _with_gaps(lines: Sequence[Line]) -> list[Line]:
    """Add to each row its PSNR of the hand against that of the same method without noise, dB; by method and level."""
    zero = {line.name.partition("@")[0]: line.figures["psnr_hand"] for line in lines if line.name.endswith("@0mm")}
    found = []
    for line in sorted(lines, key=lambda line: line.name.partition("@")[0]):
        method = line.name.partition("@")[0]
        gap = {"gap_db": line.figures["psnr_hand"] - zero[method]} if method in zero else {}
        found.append(replace(line, figures={**line.figures, **gap}))
    return found


def _digest(value: Any) -> str:
    return hashlib.sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()


def _text(value: Any) -> str:
    return json.dumps(value, indent=1, default=str) + "\n"


def _read(path: Path) -> dict[str, Any]:
    """Read a JSON object; empty if there is none."""
    try:
        document = json.loads(path.read_text())
    except (OSError, ValueError):
        return {}
    return document if isinstance(document, dict) else {}
