"""The tables as Markdown, HTML and JSON: the paper's figures, ours, and what is to be said below them."""

from __future__ import annotations

import html
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import Any, Literal

from ...evaluation.report import write_text
from .published import CONCEPTUAL, PUBLISHED, TITLES

_SIZE_PX, _MARGIN_PX = (560.0, 300.0), 48.0
_COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")  # Okabe and Ito's


def svg_curves(series: Mapping[str, Sequence[tuple[float, float]]], x_label: str, y_label: str) -> str:
    """Draw a line with points for each name; both axes span all points. Empty if no line has two points."""
    drawn = {name: sorted(points) for name, points in series.items() if len(points) > 1}
    if not drawn:
        return ""
    xs, ys = zip(*(point for points in drawn.values() for point in points), strict=True)
    spans = [(min(values), max(max(values), min(values) + 1e-9)) for values in (xs, ys)]
    width, height = _SIZE_PX
    whole = f"{width + 220:.0f}"
    parts = [f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {whole} {height:.0f}" width="{whole}">']
    left, right, top, bottom = _MARGIN_PX, width - _MARGIN_PX, _MARGIN_PX / 2, height - _MARGIN_PX
    parts.append(f'<path d="M{left} {top}V{bottom}H{right}" fill="none" stroke="#999"/>')
    for index, (name, points) in enumerate(drawn.items()):
        colour = _COLOURS[index % len(_COLOURS)]
        points = [_place(point, spans, (left, right, top, bottom)) for point in points]
        line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts += [f'<circle cx="{x:.1f}" cy="{y:.1f}" r="3" fill="{colour}"/>' for x, y in points]
        parts.append(_text(width - 20, 30.0 + 20 * index, name, colour))
    (low_x, high_x), (low_y, high_y) = spans
    parts += [_text(left, bottom + 18, f"{low_x:g}"), _text(right - 10, bottom + 18, f"{high_x:g}")]
    parts += [_text(4.0, bottom, f"{low_y:.1f}"), _text(4.0, top + 10, f"{high_y:.1f}")]
    parts += [_text((left + right) / 2 - 60, bottom + 36, x_label), _text(left + 6, top + 10, y_label), "</svg>"]
    return "".join(parts)


def _place(
    point: tuple[float, float], spans: Sequence[tuple[float, float]], box: tuple[float, float, float, float]
) -> tuple[float, float]:
    """Place a point in the drawing's pixels."""
    left, right, top, bottom = box
    x, y = ((value - low) / (high - low) for value, (low, high) in zip(point, spans, strict=True))
    return left + x * (right - left), bottom - y * (bottom - top)


def _text(x: float, y: float, text: str, colour: str = "#333") -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" font-size="12" fill="{colour}">{html.escape(text)}</text>'


Better = Literal["high", "low", ""]
_PAPER = "P: "

# Key of a figure, heading, digits, factor, what is better.
_COLUMNS: tuple[tuple[str, str, int, float | int, Better], ...] = (
    ("images", "n", 0, 1, ""),
    ("psnr_full", "PSNR dB", 2, 1, "high"),
    ("psnr_hand", "PSNR hand", 2, 1, "high"),
    ("ssim", "SSIM", 4, 1, "high"),
    ("lpips", "LPIPS x1000", 2, 1000, "low"),
    ("lpips_reference", "LPIPS x1000 in [0, 1]", 2, 1000, "low"),
    ("lpips_vgg16", "LPIPS (VGG16) x1000", 2, 1000, "low"),
    ("lpips_vgg16_reference", "LPIPS (VGG16) x1000 in [0, 1]", 2, 1000, "low"),
    ("lpips_squeezenet1_1", "LPIPS (SqueezeNet) x1000", 2, 1000, "low"),
    ("lpips_squeezenet1_1_reference", "LPIPS (SqueezeNet) x1000 in [0, 1]", 2, 1000, "low"),
    ("uncalibrated", "uncalibrated x1000", 2, 1000, "low"),
    ("uncalibrated_reference", "uncalibrated x1000 in [0, 1]", 2, 1000, "low"),
    ("vgg19", "VGG19", 4, 1, "low"),
    ("inception_frechet", "FID", 2, 1, "low"),
    ("inception_kid", "KID x1000", 2, 1000, "low"),
    ("vgg19_frechet", "vgg19_frechet", 2, 1, "low"),
    ("vgg19_frechet_deviation", "+-", 2, 1, ""),
    ("vgg19_kid", "vgg19_kid", 3, 1, "low"),
    ("vgg19_kid_deviation", "+-", 3, 1, ""),
    ("alpha_iou", "alpha IoU", 4, 1, "high"),
    ("vertex_mm", "mesh off, mm", 2, 1, ""),
    ("gap_db", "against its 0 mm, dB", 2, 1, ""),
    ("parameters_m", "parameters, M", 3, 1, "low"),
    ("steps", "steps", 0, 1, ""),
    ("core_minutes", "core-min", 1, 1, ""),
    ("ms", "ms", 1, 1, "low"),
    ("ms_p10", "10 %", 1, 1, ""),
    ("ms_p90", "90 %", 1, 1, ""),
    ("core_s", "core-s", 3, 1, "low"),
)
_PUBLISHED_COLUMNS: tuple[tuple[str, str, int, Better], ...] = (
    ("psnr_db", "PSNR dB", 2, "high"),
    ("lpips_1000", "LPIPS x1000", 2, "low"),
    ("fid", "FID", 2, "low"),
    ("fps", "FPS, RTX 3090", 2, "high"),
    ("parameters_m", "parameters, M", 2, "low"),
)


@dataclass(frozen=True)
class Line:
    """A row of a table.

    Attributes:
        name: of the row; its published figures go by it.
        label: shown.
        figures: by key; missing ones are empty cells.
        notes: below the table.
    """

    name: str
    label: str
    figures: Mapping[str, float | int]
    notes: str


@dataclass(frozen=True)
class Table:
    """A table of one split.

    Attributes:
        key: of the table, in `published.TITLES`.
        split: that was measured.
        lines: its rows.
    """

    key: str
    split: str
    lines: tuple[Line, ...]

    @property
    def title(self) -> str:
        """Above the table."""
        return f"{TITLES[self.key]}: {self.split}"

    def cells(self) -> list[list[str]]:
        """List heading and rows; the best of each column is marked with `**`."""
        published = self._published()
        ours = [column for column in _COLUMNS if any(column[0] in line.figures for line in self.lines)]
        heading = ["row", *(heading for heading, _ in published), *(heading for _, heading, *_ in ours)]
        columns = [[line.label for line in self.lines], *(cells for _, cells in published)]
        for key, _, digits, factor, better in ours:
            values = [_scaled(line.figures.get(key), factor) for line in self.lines]
            columns.append(_marked(values, digits, better))
        return [heading, *(list(row) for row in zip(*columns, strict=True))]

    def curves(self) -> str:
        """Draw the misfit: each method's loss over the noise, as SVG; else empty."""
        series: dict[str, list[tuple[float, float]]] = {}
        for line in self.lines:
            name, _, level = line.name.partition("@")
            if level.endswith("mm") and "gap_db" in line.figures:
                series.setdefault(name, []).append((float(level.removesuffix("mm")), line.figures["gap_db"]))
        return svg_curves(series, "noise on landmarks, mm an axis", "PSNR of the hand, dB")

    def _published(self) -> list[tuple[str, list[str]]]:
        if self.key == "misfit" or self.split != "novel_pose":
            return []
        found = []
        for key, heading, digits, better in _PUBLISHED_COLUMNS:
            values = [getattr(PUBLISHED[line.name], key) if line.name in PUBLISHED else None for line in self.lines]
            if any(value is not None for value in values):
                found.append((_PAPER + heading, _marked(values, digits, better)))
        return found


@dataclass(frozen=True)
class Page:
    """All tables.

    Attributes:
        tables: in order.
        facts: capture, budget, machine and so on, as lines.
        remarks: rows that could not be fitted, and why.
    """

    tables: tuple[Table, ...]
    facts: Mapping[str, Any]
    remarks: tuple[str, ...] = ()

    def save(self, folder: Path) -> None:
        """Write `tables.md`, `tables.html` and `tables.json`.

        Raises:
            LiveHandError: they cannot be written.
        """
        write_text(self.markdown(), folder / "tables.md")
        write_text(self.html(), folder / "tables.html")
        write_text(self.json(), folder / "tables.json")

    def markdown(self) -> str:
        """Write the page as Markdown."""
        lines = ["# The paper's tables, on this capture", "", *self._facts(), ""]
        for table in self.tables:
            lines += [f"## {table.title}", "", *_markdown_table(table.cells()), "", *self._notes(table), ""]
        lines += ["## Conceptual comparison (table 1)", "", *_markdown_table(_conceptual()), "", *_FOOTNOTES, ""]
        lines += [f"- {remark}" for remark in self.remarks]
        return "\n".join(lines).rstrip() + "\n"

    def html(self) -> str:
        """Write the page as one HTML file without scripts."""
        parts = [f"<h1>The paper's tables, on this capture</h1>{_list(self._facts())}"]
        for table in self.tables:
            parts += [f"<h2>{html.escape(table.title)}</h2>", _html_table(table.cells()), table.curves()]
            parts.append(_list(self._notes(table)))
        parts += ["<h2>Conceptual comparison (table 1)</h2>", _html_table(_conceptual())]
        parts += [_list([*_FOOTNOTES, *self.remarks])]
        return f"<!doctype html>\n<meta charset='utf-8'>\n<style>{_STYLE}</style>\n" + "\n".join(parts) + "\n"

    def json(self) -> str:
        """Write the figures as they are."""
        tables = [
            {
                "table": table.key,
                "split": table.split,
                "rows": [{"name": line.name, "label": line.label, **_finite(line.figures)} for line in table.lines],
            }
            for table in self.tables
        ]
        published = {name: figures._asdict() for name, figures in PUBLISHED.items()}
        document = {"facts": self.facts, "tables": tables, "published": published, "remarks": self.remarks}
        return json.dumps(document, indent=1, allow_nan=False) + "\n"

    def _facts(self) -> list[str]:
        return [f"- {name}: {value}" for name, value in self.facts.items()]

    @staticmethod
    def _notes(table: Table) -> list[str]:
        return list(dict.fromkeys(f"- {line.label}: {line.notes}" for line in table.lines if line.notes))


_STYLE = (
    "body{font:15px/1.5 sans-serif;margin:2em}table{border-collapse:collapse}"
    "td,th{border:1px solid #999;padding:2px 8px;text-align:right}td:first-child{text-align:left}"
)
_FOOTNOTES = [
    f"- Columns that begin with `{_PAPER}` are the paper's, of other data and an RTX 3090; only the order of rows can "
    "be compared. Its frames a second stand in no relation to our milliseconds.",
    "- Our figures are defined on the evaluation's page; `vgg19` and `uncalibrated` are not LPIPS, `vgg19_frechet` and "
    "`vgg19_kid` not FID and KID; compare distances of distributions only at equal n. +- is a bootstrap's deviation.",
    "- Milliseconds: pose to RGBA in memory, skinning and drawing included, all rows in turns on the same frames; "
    "core-seconds count the processor time of all threads.",
]


def _conceptual() -> list[list[str]]:
    heading = ["", "real-time", "photoreal", "pose-dependent", "view-dependent look"]
    return [heading, *([name, *("yes" if has else "no" for has in features)] for name, *features in CONCEPTUAL)]


def _scaled(value: float | int | None, factor: float | int) -> float | None:
    return None if value is None or not isfinite(value) else float(value * factor)


def _marked(values: Sequence[float | None], digits: int, better: Better) -> list[str]:
    """Mark cells in bold, the best of several; values that look alike are equally good."""
    texts = ["" if value is None else f"{value:.{digits}f}" for value in values]
    known = [value for value in values if value is not None]
    if not better or len(known) < 2:
        return texts
    best = f"{(max if better == 'high' else min)(known):.{digits}f}"
    return [f"**{text}**" if text == best else text for text in texts]


def _markdown_table(cells: Sequence[Sequence[str]]) -> list[str]:
    heading, *rows = cells
    rule = ["---", *["---:"] * (len(heading) - 1)]
    return ["| " + " | ".join(row) + " |" for row in (heading, rule, *rows)]


def _html_table(cells: Sequence[Sequence[str]]) -> str:
    heading, *rows = cells
    lines = ["<tr>" + "".join(f"<th>{html.escape(cell)}</th>" for cell in heading) + "</tr>"]
    lines += ["<tr>" + "".join(f"<td>{_bold(cell)}</td>" for cell in row) + "</tr>" for row in rows]
    return "<table>\n" + "\n".join(lines) + "\n</table>"


def _bold(cell: str) -> str:
    text = html.escape(cell.strip("*"))
    return f"<b>{text}</b>" if cell.startswith("**") else text


def _list(lines: Sequence[str]) -> str:
    return "<ul>" + "".join(f"<li>{html.escape(line.removeprefix('- '))}</li>" for line in lines) + "</ul>"


def _finite(figures: Mapping[str, float | int]) -> dict[str, float | int | None]:
    return {key: value if isfinite(value) else None for key, value in figures.items()}
