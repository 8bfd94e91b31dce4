"""People who ship as numbers: their records, and that their skin is drawn once."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars import drawn_people
from livehand.backend.avatars.file import load_avatar, read_header, write_record
from livehand.backend.avatars.library import PERSONS, SHIPPED, SKINS, avatar_path, shipped_avatar_path, shipped_skin
from livehand.backend.avatars.metadata import read_metadata
from livehand.backend.avatars.origin import read_origin
from livehand.backend.records.errors import LiveHandError
from livehand.backend.surface.people.look import PersonLook

DRAWN = [name for name in SHIPPED if name not in SKINS]


@pytest.fixture
def light(monkeypatch, tmp_path):
    """The light avatar, where the user's data is empty."""
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))
    return load_avatar(shipped_avatar_path("light"))


@pytest.fixture
def drawn(light, monkeypatch):
    """The looks that were drawn: as the light avatar, but for the melanin."""
    looks = []

    def draw(hand, look, name, base):
        looks.append((look, base.name))
        return replace(light, name=name, surface=replace(light.surface, person=look.person()))

    monkeypatch.setattr(drawn_people, "drawn_avatar", draw)
    return looks


def test_six_people_ship_of_both_builds_all_ages_and_four_tones():
    looks = [drawn_people.look_of(read_header(avatar_path(name)), avatar_path(name)) for name in DRAWN]
    assert len(looks) == 6
    assert sorted(look.build < 0.5 for look in looks) == [False] * 3 + [True] * 3
    assert min(look.age for look in looks) < 25
    assert max(look.age for look in looks) > 70
    tones = sorted(look.tone for look in looks)
    assert tones[0] < 0.1
    assert tones[-1] > 0.9
    assert max(np.diff(tones)) < 0.35
    assert len({look.seed for look in looks}) == 6


@pytest.mark.parametrize("name", DRAWN)
def test_a_record_tells_what_users_choose_by_and_is_small(name, hand):
    path = shipped_avatar_path(name)
    metadata = read_metadata(path)
    assert (metadata.name, shipped_skin(path)) == (PERSONS[name], name)
    assert metadata.hand_sha256 == hand.sha256
    assert metadata.licence == read_metadata(shipped_avatar_path("light")).licence != ""
    assert metadata.thumbnail.shape == (96, 96, 4)
    assert (metadata.thumbnail[..., 3] == 255).mean() > 0.1
    assert metadata.beta == drawn_people.look_of(read_header(path), path).person().beta
    assert path.stat().st_size < 40_000


def test_an_avatar_is_found_by_its_name_and_by_its_persons():
    for name in SHIPPED:
        assert avatar_path(name) == avatar_path(PERSONS[name]) == shipped_avatar_path(name)


def test_pictures_of_each_have_an_origin_of_their_own():
    assert len({read_origin(shipped_avatar_path(name)).payload for name in SHIPPED}) == len(SHIPPED)


def test_a_person_is_drawn_once_and_kept(drawn, tmp_path):
    first, second = (load_avatar(avatar_path("amara")) for _ in range(2))
    assert [(look.seed, base) for look, base in drawn] == [(57, "deep")]
    assert first.name == second.name == "Amara"
    assert first.surface.person == second.surface.person
    assert np.array_equal(second.thumbnail, read_metadata(avatar_path("amara")).thumbnail)
    assert len(list((tmp_path / "data" / "livehand" / "people").iterdir())) == 1


def test_another_person_under_the_same_name_is_drawn_anew(drawn, light, tmp_path):
    path = tmp_path / "anna.safetensors"
    for seed in (1, 2):
        look = PersonLook.of(seed, {"tone": 0.1})
        write_record(replace(light, name="Anna", surface=replace(light.surface, person=look.person())), look, path)
        assert load_avatar(path).surface.person.beta == look.person().beta
    assert [look.seed for look, _ in drawn] == [1, 2]


def test_who_cannot_be_kept_is_drawn_all_the_same(drawn, tmp_path, caplog):
    (tmp_path / "data").write_text("no folder")
    assert load_avatar(avatar_path("amara")).name == "Amara"
    assert "drawn anew each time" in caplog.text


@pytest.mark.parametrize(
    ("changed", "fault"),
    [
        ({"age": 200.0}, "age must be from 18 to 90"),
        ({"tone": "dark"}, "numbers must be numbers"),
        ({"charm": 1.0}, "its numbers must be age, blood"),
    ],
)
def test_wrong_numbers_are_refused(changed, fault, tmp_path):
    header = read_header(avatar_path("lena"))
    with pytest.raises(LiveHandError, match=fault):
        drawn_people.look_of({**header, "look": {**header["look"], **changed}}, tmp_path)
