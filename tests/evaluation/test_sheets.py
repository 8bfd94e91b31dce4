"""Which views the sheets show."""

import numpy as np
import pytest
from livehand.backend.evaluation.evaluate import ScoredView, ViewScore
from livehand.backend.evaluation.sheets import SheetViews, label_of


def view(index, psnr_hand, angle_deg=12.4):
    picture = np.zeros((2, 2, 4), np.float32)
    figures = {"psnr_full": psnr_hand + 5, "psnr_hand": psnr_hand}
    return ScoredView(ViewScore(f"images/{index}.png", "test", 0, 0, angle_deg, figures), picture, picture)


def files(views):
    return [int(shown.score.file[7:-4]) for shown in views]


def test_the_worst_views_have_the_lowest_psnr_on_the_hand_lowest_first():
    psnr = [33.0, 29.0, 35.0, 28.0, 29.0, 40.0]
    shown = SheetViews(6, spread=2, worst=3)
    passed = list(shown.watch(view(index, value) for index, value in enumerate(psnr)))
    assert files(passed) == list(range(6))
    assert files(shown.worst) == [3, 1, 4]
    assert files(shown.spread) == [0, 3]


@pytest.mark.parametrize(
    ("expected", "spread", "indices"), [(10, 5, [0, 2, 4, 6, 8]), (3, 5, [0, 1, 2]), (7, 3, [0, 2, 4])]
)
def test_the_contact_sheet_is_spread_evenly(expected, spread, indices):
    shown = SheetViews(expected, spread, worst=0)
    for _ in shown.watch(view(index, 30.0) for index in range(expected)):
        pass
    assert files(shown.spread) == indices
    assert shown.worst == []


def test_sheets_without_views_are_not_written(tmp_path):
    SheetViews(3, 0, 0).save(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_label_names_the_view_and_its_figures():
    assert label_of(view(7, 30.126)) == "7  test  angle 12°  35.13 dB  hand 30.13 dB"
    assert "angle" not in label_of(view(7, 30.0, angle_deg=float("nan")))
