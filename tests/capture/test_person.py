"""The people of synthetic captures."""

import json

import pytest
from livehand.backend.capture.person import PERSONS, Person, find_person
from livehand.backend.records.errors import LiveHandError


def test_the_table_and_a_file_of_the_same_numbers_are_the_same_person(tmp_path):
    path = tmp_path / "someone.json"
    for name, person in PERSONS.items():
        path.write_text(json.dumps(person.facts()))
        assert find_person(name) == find_person(str(path)) == person


def test_numbers_that_a_file_does_not_name_are_usual(tmp_path):
    path = tmp_path / "someone.json"
    path.write_text('{"melanin": 0.3, "nail_polish": [0.5, 0, 0.02]}')
    assert find_person(str(path)) == Person(melanin=0.3, nail_polish=(0.5, 0.0, 0.02))


@pytest.mark.parametrize(
    ("text", "rule"),
    [
        ("[]", "JSON object with keys of melanin"),
        ('{"skin": 1}', "JSON object with keys of melanin"),
        ('{"melanin": 3}', "melanin must be a number between 0.0 and 1.2, got 3"),
        ('{"folds": "many"}', "folds must be a number"),
        ('{"freckles": true}', "freckles must be a number"),
        ('{"veins_mm": NaN}', "number"),
        ('{"beta": [0, 1]}', "beta must be a list of 10 numbers"),
        ('{"nail_polish": [0, 0, 7]}', "nail_polish must be a number between 0.0 and 1.0, got 7"),
    ],
)
def test_a_file_out_of_range_is_an_error(tmp_path, text, rule):
    path = tmp_path / "someone.json"
    path.write_text(text)
    with pytest.raises(LiveHandError, match=r"someone\.json") as error:
        find_person(str(path))
    assert rule in str(error.value)


def test_an_unknown_name_lists_the_known_ones():
    with pytest.raises(LiveHandError, match="light, middle, deep, old or a JSON file, got 'nobody'"):
        find_person("nobody")


def test_usual_tendons_go_without_saying_so_that_files_of_before_keep_their_identity(tmp_path):
    assert "tendons" not in Person().facts()
    weak, path = Person(tendons=0.4), tmp_path / "someone.json"
    path.write_text(json.dumps(weak.facts()))
    assert find_person(str(path)) == weak
