"""The plot of a take's fit errors: its curves and shades by value."""

import numpy as np
import pytest
from livehand.backend.commands.track import draw_fit_error
from livehand.backend.motion.landmarks.take_fit import TakeFit
from livehand.backend.motion.motion import HandMotion
from livehand.backend.system.figure import new_figure, save_figure


def fit_of(fit_error, is_keyed, start_s):
    count = len(fit_error)
    motion = HandMotion(np.zeros((count, 16, 3)), np.zeros(10), np.zeros((count, 3)), 10.0)
    return TakeFit(motion, start_s, np.array(is_keyed, bool), np.array(fit_error), 0)


@pytest.mark.slow
def test_a_panel_a_hand_with_its_gaps(tmp_path):
    pytest.importorskip("matplotlib")
    fits = {
        "right": fit_of([0.01, 0.02, 1, 1, 0.05], [1, 1, 0, 0, 1], 0.5),
        "left": fit_of([0.03, 0.03], [1, 1], 0.0),
    }
    figure = new_figure(9.0, 5.0)
    draw_fit_error(figure, fits)
    right, left = figure.axes
    np.testing.assert_allclose(right.lines[0].get_xdata(), [0.5, 0.6, 0.7, 0.8, 0.9])
    np.testing.assert_allclose(right.lines[0].get_ydata(), [1, 2, np.nan, np.nan, 5])
    (shade,) = right.patches
    np.testing.assert_allclose(
        (shade.get_extents().x0, shade.get_extents().x1), right.transData.transform([(0.65, 0), (0.85, 0)])[:, 0]
    )
    assert not left.patches
    assert (right.get_title(), left.get_title()) == ("right hand", "left hand")
    save_figure(figure, tmp_path / "fit_error.png")
    assert (tmp_path / "fit_error.png").stat().st_size > 5000
