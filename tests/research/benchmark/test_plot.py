"""The growth plot: its curves by value, and the written picture."""

import sys

import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.research.benchmark.growth import GrowthPoint
from livehand.backend.research.benchmark.measure import SizeResult
from livehand.backend.research.benchmark.plot import draw_growth, growth_figure
from livehand.backend.research.benchmark.stopwatch import Cost, Spread
from livehand.backend.system.figure import save_figure
from PIL import Image


def spread_of(ms):
    return Spread(ms, 0.9 * ms, 1.2 * ms)


def test_a_plot_draws_every_panel_and_curve(tmp_path):
    coverage = [
        GrowthPoint(x, {"default_bf16": spread_of(100 * x), "default_fp32": spread_of(200 * x)}) for x in (0.1, 0.4)
    ]
    hands = [GrowthPoint(x, {"default_bf16": spread_of(10 * x)}) for x in (1.0, 2.0, 3.0)]
    sizes = [
        SizeResult(size, 0.2, {name: {0: {"all": Cost(ms, 0.0)}} for name in ("default_bf16", "published")}, {}, {})
        for size, ms in (((1000, 500), 20.0), ((100, 50), 5.0))
    ]
    figure = growth_figure()
    draw_growth(figure, coverage, sizes, hands, "334x512")
    labels = [axes.get_legend_handles_labels()[1] for axes in figure.axes]
    assert labels == [["default_bf16", "default_fp32"], ["default_bf16"], ["default_bf16"]]
    curves = [axes.lines[0].get_xydata().tolist() for axes in figure.axes]
    assert curves == [[[0.1, 10], [0.4, 40]], [[0.005, 5], [0.5, 20]], [[1, 10], [2, 20], [3, 30]]]
    assert all(axes.get_xlim()[0] == axes.get_ylim()[0] == 0 for axes in figure.axes)
    bars = figure.axes[2].containers[0][2][0].get_segments()
    np.testing.assert_allclose(bars, [[[x, 9 * x], [x, 12 * x]] for x in (1, 2, 3)])
    save_figure(figure, tmp_path / "new" / "plot.png")
    pixels = np.asarray(Image.open(tmp_path / "new" / "plot.png").convert("RGB")).astype(int)
    for panel in np.array_split(pixels, 3, axis=1):
        assert (np.ptp(panel, axis=-1) > 60).sum() > 300  # coloured
    (tmp_path / "file").write_text("")
    with pytest.raises(LiveHandError, match="could not be written"):
        save_figure(figure, tmp_path / "file" / "plot.png")


def test_a_missing_matplotlib_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(LiveHandError, match="--plot needs matplotlib"):
        growth_figure()
