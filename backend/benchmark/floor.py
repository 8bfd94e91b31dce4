"""The least time a stage could take on a machine: its arithmetic at peak, or its bytes at bandwidth if that is more."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from .counts import Work
from .machine import Peaks

# Where a renderer does not tell a stage, the stage that does its work: in one that marches (and so tells when it
# rasterises), and in one that traces.
_DONE_WITHIN_MARCH = {"gather": "sample", "volume": "sample"}
_DONE_WITHIN_TRACE = {"rasterise": "sample", "gather": "field", "volume": "field"}


def floor_ms(work: Work, peaks: Peaks, precision: str) -> float:
    """One stage's floor; `precision` is the networks'."""
    is_half = work.unit == "network" and precision == "bf16"
    arithmetic_s = work.flop / (peaks.bf16_flops if is_half else peaks.fp32_flops)
    return 1000 * max(arithmetic_s, work.bytes / peaks.bytes_per_s)


def floors_ms(works: Mapping[str, Work], peaks: Peaks, precision: str, told: Iterable[str]) -> dict[str, float]:
    """The floors of the stages that were told; that of one that was not is added to the stage it is done within."""
    floors = dict.fromkeys(told, 0.0)
    done_within = _DONE_WITHIN_MARCH if "rasterise" in floors else _DONE_WITHIN_TRACE
    for stage, work in works.items():
        owner = stage if stage in floors else done_within.get(stage, stage)
        if owner in floors:
            floors[owner] += floor_ms(work, peaks, precision)
    return floors
