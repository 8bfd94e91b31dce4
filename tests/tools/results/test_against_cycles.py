"""Tables of avatars against Cycles: views fall into their cells, and means are those of the cells."""

from livehand.tools.results.against_cycles import MeasuredView, tables_of

SOURCE = {"what": "`livehand x`", "date": "2026-11-28", "commit": "abc1234"}


def view(person, kind, is_close, psnr, flip=0.02):
    figures = {"psnr_hand": psnr, "psnr_full": psnr + 6, "ssim_hand": 0.95, "flip": flip, "lpips": 0.04}
    return MeasuredView(person, kind, is_close, figures)


VIEWS = [
    view("light", "key", False, 34.0),
    view("light", "soft", True, 33.0, flip=0.04),
    view("lena", "key", False, 36.0),
    view("lena", "key", True, 30.0),
]


def test_views_are_tabulated_by_light():
    assert tables_of(VIEWS, SOURCE)["psnr"]["rows"] == [
        ["soft", "-", "33.0 (1)"],
        ["key", "35.0 (2)", "30.0 (1)"],
        ["all", "35.0 (2)", "31.5 (2)"],
    ]


def test_views_are_tabulated_by_person():
    assert tables_of(VIEWS, SOURCE)["people"]["rows"] == [
        ["Erik", "34.0 (1)", "33.0 (1)", "39.5", "0.950", "0.030", "0.040"],
        ["Lena", "36.0 (1)", "30.0 (1)", "39.0", "0.950", "0.020", "0.040"],
    ]
