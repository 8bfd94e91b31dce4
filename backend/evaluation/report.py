"""The results of an evaluation as text: scores.csv, summary.json and summary.txt."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping, Sequence
from math import isfinite, log10
from pathlib import Path
from statistics import fmean

from ..system.files import replacing
from .breakdown import CAUSES, REGIONS
from .contrast_bands import BANDS_MM, CONTRAST_KEYS, SPAN, TRUTH
from .evaluate import ViewScore

Summary = dict[str, float | int]
_DIGITS = 4
_MAX_GAIN_DB = 99.0


def summary(scores: Sequence[ViewScore]) -> Summary:
    """Average the scores: `images`, mean and largest train-view angle, and each metric over views that define it.

    Metrics that no view defines are left out. `share_*` are shares of the total squared error of all images, in which
    each image counts with its mean squared error. The angle keeps its key of earlier files, `camera_gap_deg`.
    """
    figures = [{"camera_gap_deg": score.train_view_angle_deg, **score.figures} for score in scores]
    names = dict.fromkeys(name for of_view in figures for name in of_view)
    columns = {name: [of_view[name] for of_view in figures if isfinite(of_view[name])] for name in names}
    found: Summary = {"images": len(scores)}
    found |= {name: round(fmean(values), _DIGITS) for name, values in columns.items() if values}
    if columns["camera_gap_deg"]:
        found["camera_gap_max_deg"] = round(max(columns["camera_gap_deg"]), _DIGITS)
    return found | _pooled_shares(figures)


def by_split(scores: Sequence[ViewScore]) -> dict[str, Summary]:
    """Summarise each split that has views."""
    splits = sorted({score.split for score in scores})
    return {split: summary([score for score in scores if score.split == split]) for split in splits}


def by_light(scores: Sequence[ViewScore]) -> dict[str, Summary]:
    """Summarise each split's views in each kind of light, by names such as `test soft`; empty without lights."""
    kinds = sorted({(score.split, score.light_kind) for score in scores if score.light_kind is not None})
    return {
        f"{split} {kind}".rstrip(): summary([one for one in scores if (one.split, one.light_kind) == (split, kind)])
        for split, kind in kinds
    }


def gain_db(share: float) -> float:
    """Compute how much the whole image's PSNR would rise without a share of its squared error; at most 99 dB."""
    return min(10 * log10(1 / (1 - share)), _MAX_GAIN_DB) if share < 1 else _MAX_GAIN_DB


def _pooled_shares(figures: Sequence[dict[str, float]]) -> Summary:
    errors = [10 ** (-of_view["psnr_full"] / 10) for of_view in figures]
    pooled = {}
    for name in (f"share_{cause}" for cause in CAUSES):
        of_images = (error * of_view[name] for error, of_view in zip(errors, figures, strict=True))
        pooled[name] = round(sum(of_images) / sum(errors), _DIGITS)
    return pooled


# Key, heading, digits. A metric that was not measured has no column.
_QUALITY = (
    ("images", "images", 0),
    ("camera_gap_deg", "angle deg", 1),
    ("psnr_full", "PSNR dB", 2),
    ("psnr_hand", "hand", 2),
    ("ssim", "SSIM", 4),
    ("ssim_hand", "hand", 4),
    ("ms_ssim", "MS-SSIM", 4),
    ("ms_ssim_hand", "hand", 4),
    ("flip", "FLIP", 4),
    ("flip_hand", "hand", 4),
    ("lpips", "LPIPS", 4),
    ("lpips_hand", "hand", 4),
    ("lpips_reference", "in [0, 1]", 4),
    ("lpips_reference_hand", "hand", 4),
    ("lpips_vgg16", "LPIPS (VGG16)", 4),
    ("lpips_vgg16_hand", "hand", 4),
    ("lpips_vgg16_reference", "in [0, 1]", 4),
    ("lpips_vgg16_reference_hand", "hand", 4),
    ("lpips_squeezenet1_1", "LPIPS (SqueezeNet)", 4),
    ("lpips_squeezenet1_1_hand", "hand", 4),
    ("lpips_squeezenet1_1_reference", "in [0, 1]", 4),
    ("lpips_squeezenet1_1_reference_hand", "hand", 4),
    ("uncalibrated", "uncalibrated", 4),
    ("uncalibrated_hand", "hand", 4),
    ("uncalibrated_reference", "in [0, 1]", 4),
    ("uncalibrated_reference_hand", "hand", 4),
    ("vgg19", "VGG19", 4),
    ("vgg19_hand", "hand", 4),
    ("alpha_iou", "alpha IoU", 4),
)
_IDENTITY = ("file", "split", "camera_index", "pose_index", "camera_gap_deg")


def scores_csv(scores: Sequence[ViewScore]) -> str:
    """Write a line for each image; the cell of an undefined metric is empty."""
    names = list(dict.fromkeys(name for score in scores for name in score.figures))
    lines = io.StringIO()
    writer = csv.writer(lines, lineterminator="\n")
    is_lit = any(score.light_kind is not None for score in scores)
    writer.writerow((*_IDENTITY, *(["light_kind"] if is_lit else []), *names))
    for score in scores:
        identity = [getattr(score, name) for name in _IDENTITY[:-1]]
        light = [score.light_kind] if is_lit else []
        angle, numbers = _digits(score.train_view_angle_deg, 2), [_digits(score.figures[name], 5) for name in names]
        writer.writerow((*identity, angle, *light, *numbers))
    return lines.getvalue()


def summary_tables(summaries: Mapping[str, Summary]) -> str:
    """Write tables with a line for each name: metrics, breakdown of the squared error, and contrast if measured."""
    columns = [column for column in _QUALITY if any(column[0] in figures for figures in summaries.values())]
    quality = [["", *(heading for _, heading, _ in columns)]]
    for name, figures in summaries.items():
        quality.append([name, *(_digits(figures.get(key), digits) for key, _, digits in columns)])
    breakdown = [["squared error at", *CAUSES, "true alpha"]]
    for name, figures in summaries.items():
        breakdown += _breakdown_rows(name, figures)
    tables = [_table(quality), _table(breakdown)]
    if any(SPAN in figures for figures in summaries.values()):
        tables.append(_table(_contrast_rows(summaries)))
    return "\n\n".join(tables)


def _contrast_rows(summaries: Mapping[str, Summary]) -> list[list[str]]:
    bands = [f"{fine}-{coarse} mm" for fine, coarse in BANDS_MM]
    rows = [["contrast, L*", *bands, "span"]]
    for name, figures in summaries.items():
        for label, ending in ((name, ""), ("  of the truth", TRUTH)):
            rows.append([label, *(_digits(figures.get(key + ending), 2) for key in CONTRAST_KEYS)])
    return rows


def _breakdown_rows(name: str, figures: Summary) -> list[list[str]]:
    shares = [figures[f"share_{cause}"] for cause in CAUSES]
    areas = [figures[f"area_{region}"] for region in REGIONS]
    gains = [gain_db(share) for share in shares] + [figures["psnr_true_alpha"] - figures["psnr_full"]]
    return [
        [name, *(f"{100 * share:.1f} %" for share in shares), ""],
        ["  of the hand's area", *(f"{100 * area:.1f} %" for area in areas), "(same)", ""],
        ["  PSNR without it", *(f"{gain:+.2f} dB" for gain in gains)],
    ]


def _table(rows: Sequence[Sequence[str]]) -> str:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for first, *others in rows:
        cells = (cell.rjust(width) for cell, width in zip(others, widths[1:], strict=True))
        lines.append("  ".join([first.ljust(widths[0]), *cells]).rstrip())
    return "\n".join(lines)


def _digits(value: float | int | None, digits: int) -> str:
    return "" if value is None or not isfinite(value) else f"{value:.{digits}f}"


def write_text(text: str, path: Path) -> None:
    """Write a file under a temporary name and rename it; its folder is created.

    Raises:
        LiveHandError: the file cannot be written.
    """
    with replacing(path) as temporary:
        temporary.write_text(text)


def summary_json(
    facts: Mapping[str, str], total: Summary, splits: Mapping[str, Summary], lights: Mapping[str, Summary]
) -> str:
    """Describe what was evaluated, with summaries of all views, each split and, in a lit capture, kind of light."""
    of_lights = {"lights": lights} if lights else {}
    return json.dumps({**facts, "all": total, "splits": splits, **of_lights}, indent=1, allow_nan=False) + "\n"
