"""Floors of invented machines."""

import pytest
from livehand.backend.research.benchmark.counts import Work
from livehand.backend.research.benchmark.machine import Peaks
from livehand.backend.research.benchmark.measure import floor_ms, floors_ms

PEAKS = Peaks(1e9, 4e9, 1e8)


@pytest.mark.parametrize(
    ("work", "precision", "expected_ms"),
    [
        (Work(2e6, 1e5), "fp32", 2.0),
        (Work(2e6, 1e5), "bf16", 2.0),  # geometry is always single precision
        (Work(2e6, 1e4, "network"), "bf16", 0.5),
        (Work(2e6, 1e4, "network"), "fp32", 2.0),
        (Work(2e6, 5e5), "fp32", 5.0),
    ],
)
def test_a_floor_is_the_larger_of_arithmetic_and_bytes(work, precision, expected_ms):
    assert floor_ms(work, PEAKS, precision) == pytest.approx(expected_ms)


def test_the_floor_of_an_unreported_stage_is_added_to_the_stage_that_does_its_work():
    works = {name: Work(k * 1e6, 0) for k, name in enumerate(("pose", "rasterise", "sample", "field", "volume"), 1)}
    assert floors_ms(works, PEAKS, "fp32", works) == {"pose": 1, "rasterise": 2, "sample": 3, "field": 4, "volume": 5}
    assert floors_ms(works, PEAKS, "fp32", ["pose", "sample", "field"]) == {"pose": 1, "sample": 5, "field": 9}


def test_the_fused_backend_samples_gathers_and_composites_in_one_stage():
    works = {name: Work(k * 1e6, 0) for k, name in enumerate(("rasterise", "sample", "gather", "volume", "field"), 1)}
    reported = ["rasterise", "sample", "field"]
    assert floors_ms(works, PEAKS, "fp32", reported) == {"rasterise": 1, "sample": 9, "field": 5}
    assert floors_ms(works, PEAKS, "fp32", reported[1:]) == {"sample": 3, "field": 12}


def test_reduced_precision_may_multiply_int8_single_precision_may_not():
    work = Work(8e9, 0, "network")
    assert floor_ms(work, PEAKS._replace(int8_flops=8e9), "bf16") == 1000
    assert floor_ms(work, PEAKS, "bf16") == 2000
    assert floor_ms(work, PEAKS._replace(int8_flops=8e9), "fp32") == 8000
