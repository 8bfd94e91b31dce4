"""The results of a benchmark as JSON and as text tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from .cases import PUBLISHED
from .growth import GrowthPoint
from .machine import Peaks
from .measure import SizeResult
from .rounds import frame_spread, paired_ratio, stage_spreads
from .stopwatch import Spread

_DEFAULTS = {"bf16": "default_bf16", "fp32": "default_fp32"}


def peaks_document(peaks: Peaks) -> dict[str, float]:
    """Write out the machine's measured peaks."""
    return {
        "fp32_tflops": round(peaks.fp32_flops / 1e12, 3),
        "bf16_tflops": round(peaks.bf16_flops / 1e12, 3),
        "int8_tflops": round(peaks.int8_flops / 1e12, 3),
        "gb_per_s": round(peaks.bytes_per_s / 1e9, 1),
    }


def size_document(result: SizeResult, peaks: Peaks) -> dict[str, Any]:
    """Write out all results at one size, keyed by case, which hold `stages`, `floor_ms` and `over_floor`."""
    floors = result.floors_ms(peaks)
    wall, cores = ({name: frame_spread(taken)[k] for name, taken in result.taken.items()} for k in (0, 1))
    return {
        "coverage": round(result.coverage, 4),
        "frames": {name: len(taken) for name, taken in result.taken.items()},
        "frame_ms": {name: _figures(spread) for name, spread in wall.items()},
        "core_s": {name: _figures(spread, 4) for name, spread in cores.items()},
        "stages": {name: _stages_document(result, name) for name in result.taken},
        "floor_ms": {name: _rounded(of_stages, 4) for name, of_stages in floors.items()},
        "over_floor": {name: _over_floor(result, name, of_stages) for name, of_stages in floors.items()},
        "ratio_paper": _ratios(result, PUBLISHED),
        "ratio_paper_bf16": _ratio(result, "paper_bf16", "default_bf16"),
        "ratio_paper_fp32": _ratio(result, "paper_fp32", "default_fp32"),
        "ratio_cycles": {
            name.removeprefix("cycles_"): _ratios(result, name) for name in result.taken if name.startswith("cycles_")
        },
        "peak_mb": {name: None if mb is None else round(mb, 1) for name, mb in result.peak_mb.items()},
    }


def growth_document(curve: Sequence[GrowthPoint], x_name: str) -> list[dict[str, Any]]:
    """Write out the points of a curve; `x_name` is the key of their x."""
    return [
        {x_name: round(point.x, 4), "frame_ms": {name: _figures(spread) for name, spread in point.frame_ms.items()}}
        for point in curve
    ]


def machine_lines(machine: Mapping[str, Any], peaks: Mapping[str, float]) -> list[str]:
    """Word the machine and its peaks, a line each."""
    described = ", ".join(f"{name} {value}" for name, value in machine.items() if value is not None)
    measured = ", ".join(f"{value} {name}" for name, value in peaks.items())
    warning = "the machine was busy before: trust core-seconds and ratios, not milliseconds"
    return [described, f"peaks: {measured}", *([warning] if machine.get("busy") else [])]


def size_lines(size: str, document: Mapping[str, Any]) -> list[str]:
    """Word one size: frames, ratios, and stages with their floors."""
    lines = [f"{size}, the hand covers {document['coverage']:.1%}", *_frame_lines(document), *_ratio_lines(document)]
    for name in (*_DEFAULTS.values(), PUBLISHED):
        lines += _stage_lines(name, document)
    return lines


def _frame_lines(document: Mapping[str, Any]) -> list[str]:
    lines = [f"  {'':14s}{'ms':>10s}{'10 % - 90 %':>20s}{'core-s':>9s}{'MB':>8s}{'frames':>8s}"]
    for name, frame in document["frame_ms"].items():
        mb = document["peak_mb"].get(name)
        spread = f"{frame['p10']:.1f} - {frame['p90']:.1f}"
        lines.append(
            f"  {name:14s}{frame['median']:10.1f}{spread:>20s}{document['core_s'][name]['median']:9.3f}"
            f"{'' if mb is None else f'{mb:.0f}':>8s}{document['frames'][name]:8d}"
        )
    return lines


def _ratio_lines(document: Mapping[str, Any]) -> list[str]:
    ratios_of = {"published / default": document["ratio_paper"]}
    ratios_of |= {f"Cycles {samples} / default": ratios for samples, ratios in document["ratio_cycles"].items()}
    lines = [
        f"  {name}: " + ", ".join(f"{ratio:.1f} ({precision})" for precision, ratio in ratios.items())
        for name, ratios in ratios_of.items()
        if ratios
    ]
    same = {p: document[f"ratio_paper_{p}"] for p in _DEFAULTS if document[f"ratio_paper_{p}"] is not None}
    if same:
        lines.append("  paper / default: " + ", ".join(f"{ratio:.1f} ({p})" for p, ratio in same.items()))
    return lines


def _stage_lines(name: str, document: Mapping[str, Any]) -> list[str]:
    if name not in document["stages"]:
        return []
    lines = [f"  {name:14s}{'ms':>10s}{'10 % - 90 %':>20s}{'core-s':>9s}{'floor':>8s}{'times':>8s}"]
    floors, over = document["floor_ms"].get(name, {}), document["over_floor"].get(name, {})
    for stage, figures in document["stages"][name].items():
        spread = f"{figures['p10']:.2f} - {figures['p90']:.2f}"
        floor, times = (f"{of[stage]:.{digits}f}" if stage in of else "" for of, digits in ((floors, 2), (over, 1)))
        lines.append(f"    {stage:12s}{figures['ms']:10.2f}{spread:>20s}{figures['core_s']:9.4f}{floor:>8s}{times:>8s}")
    return lines


def _stages_document(result: SizeResult, name: str) -> dict[str, dict[str, float]]:
    return {
        stage: {
            "ms": round(wall.median, 3),
            "p10": round(wall.p10, 3),
            "p90": round(wall.p90, 3),
            "core_s": round(cores.median, 5),
        }
        for stage, (wall, cores) in stage_spreads(result.taken[name]).items()
    }


def _over_floor(result: SizeResult, name: str, floors: Mapping[str, float]) -> dict[str, float]:
    wall = {stage: spreads[0].median for stage, spreads in stage_spreads(result.taken[name]).items()}
    return {stage: round(wall[stage] / floor, 2) for stage, floor in floors.items() if floor > 0}


def _ratios(result: SizeResult, slow: str) -> dict[str, float]:
    """Compute the ratio to the default configuration in each precision."""
    ratios = {precision: _ratio(result, slow, fast) for precision, fast in _DEFAULTS.items()}
    return {precision: ratio for precision, ratio in ratios.items() if ratio is not None}


def _ratio(result: SizeResult, slow: str, fast: str) -> float | None:
    ratio = paired_ratio(result.taken.get(slow, {}), result.taken.get(fast, {}))
    return None if ratio is None else round(ratio, 2)


def _figures(spread: Spread, digits: int = 3) -> dict[str, float]:
    return _rounded(spread._asdict(), digits)


def _rounded(values: Mapping[str, float], digits: int) -> dict[str, float]:
    return {name: round(value, digits) for name, value in values.items()}
