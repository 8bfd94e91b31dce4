"""Measured peaks, with a clock that the test moves."""

import os

import numpy as np
import torch
from livehand.backend.research.benchmark.machine import Loads, Peaks, describe, measure_peaks
from livehand.backend.research.benchmark.report import machine_lines


def test_the_higher_of_two_peaks_is_kept():
    assert Peaks(1.0, 5.0, 3.0).or_better(Peaks(2.0, 4.0, 3.0)) == Peaks(2, 5, 3)


def test_peaks_with_a_clock_that_advances_a_second_per_reading():
    for convolution, flops in (((1, 2), 2 * 5 * 6 * 7), ((4, 8), 2 * 9 * 4 * 4 * 8 * 8)):  # the higher counts
        loads = Loads(((2, 3, 4), (5, 6, 7)), convolution, copy_mb=1)
        peaks = measure_peaks(torch.device("cpu"), iter(np.arange(1000.0).tolist()).__next__, loads)
        assert peaks._replace(int8_flops=0.0) == Peaks(flops, flops, 2 * 2**20)
        assert peaks.int8_flops in (0, 4 * flops)


def test_other_programs_mark_a_machine_as_busy(monkeypatch):
    for load, expected in ((0.1, False), (7.0, True)):
        monkeypatch.setattr(os, "getloadavg", lambda load=load: (load, 0, 0))
        monkeypatch.setattr(os, "cpu_count", lambda: 4)
        machine = describe(torch.device("cpu"))
        assert (machine["load_before"], machine["busy"]) == (load, expected)
        assert any("busy" in line for line in machine_lines(machine, {})[1:]) == expected
