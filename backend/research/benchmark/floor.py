"""The least time a stage can take on a machine: its arithmetic at peak or its bytes at bandwidth, the longer one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from .counts import Work
from .machine import Peaks

# The stage that does the work of a stage that a renderer does not report: in the fused backend, which reports
# `rasterise`, and in the reference backend.
_DONE_WITHIN_FUSED = {"gather": "sample", "volume": "sample"}
_DONE_WITHIN_REFERENCE = {"rasterise": "sample", "gather": "field", "volume": "field"}


def floor_ms(work: Work, peaks: Peaks, precision: str) -> float:
    """Compute one stage's floor; `precision` is that of the networks."""
    is_half = work.unit == "network" and precision == "bf16"
    arithmetic_s = work.flop / (peaks.reduced_flops if is_half else peaks.fp32_flops)
    return 1000 * max(arithmetic_s, work.bytes / peaks.bytes_per_s)


def floors_ms(works: Mapping[str, Work], peaks: Peaks, precision: str, reported: Iterable[str]) -> dict[str, float]:
    """Compute the floors of the reported stages; that of any other stage is added to the stage that does its work."""
    floors = dict.fromkeys(reported, 0.0)
    done_within = _DONE_WITHIN_FUSED if "rasterise" in floors else _DONE_WITHIN_REFERENCE
    for stage, work in works.items():
        owner = stage if stage in floors else done_within.get(stage, stage)
        if owner in floors:
            floors[owner] += floor_ms(work, peaks, precision)
    return floors
