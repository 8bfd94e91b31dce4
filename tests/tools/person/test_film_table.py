"""The table of people from films: which frame a picture is, and what of the gates is written."""

import pytest
from livehand.backend.records.hand_picture import HandPicture
from livehand.tools.person import film_table


def figures(shift=0.0):
    contrast = {f"6 contrast, {side} side, {key}": 0.9 for side in ("seen", "unseen") for key in ("l_1_2", "l_2_4")}
    return {
        "1 true shape, PSNR dB (3: inside the family 31)": 30.04 + shift,
        "1 true shape, FLIP": 0.1,
        "2 own shape, PSNR dB": 28.0,
        "2 own shape, IoU": 0.99,
        "4 tips, mm": 5.0,
        "4 wrist, deg": 1.0,
        "4 fingers, deg": 2.0,
        "5 melanin, off by": 0.02,
        **contrast,
        "6 contrast, seen side, l_4_8": 1.012,
    }


def test_each_person_is_a_column():
    of = {name: figures(index) for index, name in enumerate(film_table.PEOPLE)}
    of["stranger1"]["7 tattoo, correlation"] = 0.83
    table = film_table.table_of(of)
    rows = {row[0]: row[1:] for row in table["rows"]}
    assert table["columns"] == ["made person", *film_table.PEOPLE.values()]
    assert rows["new poses, views and lights, true shape: PSNR, dB"] == ["30.0", "31.0", "32.0", "33.0", "34.0"]
    assert rows["fingertips, wrist, fingers off by"] == ["5.0 mm, 1.0, 2.0 deg"] * 5
    assert rows["contrast at 1-2, 2-4, 4-8 mm where it was seen"] == ["90% 90% 101%"] * 5
    assert rows["where it was not"] == [""] * 5  # a band is missing
    assert rows["tattoo, scars: correlation"] == ["", "0.83", "", "", ""]


def test_a_picture_names_its_time():
    picture = HandPicture.__new__(HandPicture)
    object.__setattr__(picture, "name", "film.mp4, 3.50 s")
    assert film_table._seconds(picture) == pytest.approx(3.5)
