"""Summaries over many views: means of the metrics, and shares of their total squared error."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite, log10
from statistics import fmean

from .breakdown import CAUSES
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
