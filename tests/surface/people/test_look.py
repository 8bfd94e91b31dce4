"""The numbers of invented people: what they may be, and what is drawn where none is given."""

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.surface.people.look import MOST_SEED, NUMBERS, PersonLook


def test_what_is_given_stays_and_the_rest_is_drawn_within_its_limits():
    for seed in range(50):
        look = PersonLook.of(seed, {"age": 61.0, "tone": None})
        assert look.age == 61.0
        for name, spec in NUMBERS.items():
            assert spec.low <= getattr(look, name) <= spec.high, name


def test_the_same_seed_is_the_same_person_and_another_is_not():
    assert PersonLook.of(7, {}) == PersonLook.of(7, {})
    assert PersonLook.of(7, {}).person().beta == PersonLook.of(7, {}).person().beta
    assert PersonLook.of(7, {}).person().beta != PersonLook.of(8, {}).person().beta


def test_the_old_have_deeper_folds_and_higher_veins():
    young, old = (PersonLook.of(3, {"age": age}) for age in (20.0, 80.0))
    assert old.folds > young.folds + 0.5
    assert old.veins > young.veins + 0.2


@pytest.mark.parametrize(
    ("name", "value"), [("age", 17.9), ("age", 91.0), ("tone", -0.1), ("hair", 3.01), ("nails", 9.0)]
)
def test_numbers_beyond_their_limits_are_refused(name, value):
    spec = NUMBERS[name]
    with pytest.raises(LiveHandError, match=f"{name} must be from {spec.low:g} to {spec.high:g}.*got {value:g}"):
        PersonLook.of(1, {name: value})


def test_what_is_no_number_is_refused():
    with pytest.raises(LiveHandError, match="age must be a number"):
        PersonLook.of(1, {"age": float("nan")})
    with pytest.raises(LiveHandError, match="the seed must be a whole number"):
        PersonLook.of(MOST_SEED + 1, {})


def test_the_persons_surface_has_the_numbers():
    person = PersonLook.of(4, {"tone": 0.7, "veins": 0.4, "folds": 1.5, "freckles": 2.0, "blood": 1.2}).person()
    assert (person.melanin, person.veins_mm, person.folds, person.freckles, person.blood) == (0.7, 0.4, 1.5, 2.0, 1.2)


def test_flesh_and_tendons_go_by_age_and_build():
    girl, man, old = (
        PersonLook.of(1, {"age": age, "build": build}) for age, build in ((24.0, 0.25), (30.0, 0.75), (74.0, 0.7))
    )
    assert girl.padding > man.padding + 0.15 > old.padding + 0.3
    assert girl.tendons < man.tendons - 0.2 < old.tendons - 0.4
    assert girl.person().tendons == girl.tendons
