"""Other numbers of a person: a light one with the tone of a deep one has their albedo; blood, hair and age by value."""

from dataclasses import replace

import numpy as np
import pytest
from livehand.backend.avatars.file import load_avatar
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.avatars.network_albedo import in_network_colours
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.person.invented import adjusting
from livehand.backend.person.invented.adjusting import adjusted_person, current_numbers
from livehand.backend.records.errors import LiveHandError
from livehand.backend.render.albedo import vertex_albedo
from livehand.backend.surface.albedo_ratio import RATIO_ARRAY, RATIO_STEP
from livehand.backend.surface.blood import BLOOD_LOG_ALBEDO
from livehand.backend.surface.hair_growth import REGIONS
from livehand.backend.surface.people.drawn_surface import grown
from livehand.backend.surface.people.look import PersonLook


@pytest.fixture(scope="module")
def light():
    """In the colours of its networks, as any avatar that was trained and not coloured since."""
    return in_network_colours(load_avatar(shipped_avatar_path("light")))


@pytest.fixture(scope="module")
def deep():
    return in_network_colours(load_avatar(shipped_avatar_path("deep")))


@pytest.fixture(autouse=True)
def no_thumbnail(monkeypatch):
    monkeypatch.setattr(adjusting, "with_thumbnail", lambda avatar, hand, device: avatar)


def adjusted(avatar, **given):
    return adjusted_person(avatar, load_default_hand(), given, "other")


@pytest.mark.nightly
def test_a_light_person_with_a_deep_ones_tone_has_their_albedo(light, deep):
    hand = load_default_hand()
    before, wanted, found = (
        np.log(vertex_albedo(one, hand).clip(0.01)) for one in (light, deep, adjusted(light, tone=1.0))
    )
    assert np.abs(wanted - before).mean() > 0.5
    assert np.abs(wanted - found).mean() < 0.04  # maps of 0.5 mm, sampled over 4 mm, in steps of 0.015


@pytest.mark.slow
def test_half_of_it_is_half_way_in_logarithms(light, deep):
    hand = load_default_hand()
    before, after, found = (
        np.log(vertex_albedo(one, hand).clip(0.01)) for one in (light, deep, adjusted(light, tone=0.5))
    )
    assert np.abs((before + after) / 2 - found).mean() < 0.05


def test_blood_reddens_all_texels_alike(light):
    arrays = adjusted(light, blood=1.5).surface.arrays
    steps = 0.5 * np.array(BLOOD_LOG_ALBEDO) / RATIO_STEP
    assert np.abs(arrays[RATIO_ARRAY] - steps).max() <= 0.5


def test_hair_counts_from_the_usual_of_invented_people(light):
    surface = adjusted(light, hair=0.5).surface
    assert {name: region.per_m2 for name, region in surface.hair.items()} == pytest.approx(
        {name: 0.5 * 1.8 * region.per_m2 for name, region in REGIONS.items()}
    )
    assert current_numbers(surface)["hair"] == pytest.approx(0.5)
    assert current_numbers(light.surface)["hair"] == pytest.approx(0.7)
    invented = {name: grown(region, PersonLook.of(3, {"hair": 0.5})) for name, region in REGIONS.items()}
    assert {name: region.per_m2 for name, region in invented.items()} == pytest.approx(
        {name: region.per_m2 for name, region in surface.hair.items()}
    )


def test_whose_hairs_are_few_has_fine_ones():
    region = next(iter(REGIONS.values()))
    few, usual, many = (grown(region, PersonLook.of(3, {"hair": hair, "age": 25.0})) for hair in (0.0, 1.0, 2.0))
    assert few.radius_m == pytest.approx(0.5 * usual.radius_m)
    assert many.radius_m == usual.radius_m


def test_an_age_sets_folds_and_veins_that_are_not_given(light):
    person = adjusted(light, age=80.0, veins=0.1).surface.person
    assert person.folds == pytest.approx(1.6)
    assert person.veins_mm == 0.1


def test_what_is_not_given_stays_and_the_numbers_are_told(light):
    other = adjusted(light, folds=1.7)
    assert RATIO_ARRAY not in other.surface.arrays
    assert other.surface.person.melanin == light.surface.person.melanin
    assert other.provenance["adjusted"] == {"folds": 1.7}
    assert current_numbers(other.surface) == pytest.approx(
        {"tone": 0.0, "blood": 1.0, "veins": 0.25, "folds": 1.7, "hair": 0.7}
    )


@pytest.mark.parametrize(
    ("given", "rule"),
    [
        ({"tone": 3.0}, r"tone must be from 0 to 1.2 .*, got 3"),
        ({"hair": float("nan")}, "hair must be a number"),
        ({"age": None}, "one of age, tone, blood, veins, folds, hair must be given, got none"),
    ],
)
def test_what_no_person_has_is_refused(light, given, rule):
    with pytest.raises(LiveHandError, match=rule):
        adjusted(light, **given)


def test_an_avatar_without_a_surface_is_refused(light):
    with pytest.raises(LiveHandError, match="only avatars with a surface"):
        adjusted(replace(light, surface=None), tone=0.5)
