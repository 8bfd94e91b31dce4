"""What is kept of an avatar's header, and the JSON of a command's last line."""

import hashlib
import json
import subprocess

import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.tools.results.collect import describe, joined, keep, recorded_cases, run, trainings_of

PERSON = {"melanin": 0.42, "beta": [0.0, -1.0]}


def header(before=None):
    provenance = {"licence": "GPL-3.0-or-later", "capture": {"plan": {"person": PERSON}}}
    metrics = {"test": {"images": 5, "psnr_hand": 34.0}, "test key": {"images": 1, "psnr_hand": 35.0}}
    return {
        "metrics": metrics,
        "provenance": provenance | ({"fine_tuned_from": {"provenance": before}} if before else {}),
    }


def test_a_header_is_kept_without_its_kinds_of_light_and_its_ancestors(tmp_path):
    path = tmp_path / "a.safetensors"
    path.write_bytes(b"abc")
    assert describe(header(header()["provenance"]), path) == {
        "sha256": hashlib.sha256(b"abc").hexdigest(),
        "bytes": 3,
        "person": PERSON,
        "licence": "GPL-3.0-or-later",
        "trainings": 2,
        "metrics": {"test": {"images": 5, "psnr_hand": 34.0}},
    }


def test_trainings_are_counted_along_the_line_of_weights():
    first = header()["provenance"]
    assert trainings_of(first) == 1
    assert trainings_of(header(header(first)["provenance"])["provenance"]) == 3


@pytest.mark.slow
def test_a_command_gives_its_last_lines_json():
    assert run(["inspect", str(shipped_avatar_path("light"))])["name"] == "light"


def test_a_command_that_fails_is_an_error(tmp_path, capfd):
    with pytest.raises(subprocess.CalledProcessError):
        run(["inspect", str(tmp_path / "none.safetensors")])
    assert "none.safetensors" in capfd.readouterr().err


def test_the_same_figures_of_another_day_change_no_file(tmp_path):
    path = tmp_path / "few.json"
    assert keep({"source": {"date": "2026-11-28"}, "people": {"light": 1}}, path)
    assert not keep({"source": {"date": "2026-11-29"}, "people": {"light": 1}}, path)
    assert json.loads(path.read_text())["source"] == {"date": "2026-11-28"}
    assert keep({"source": {"date": "2026-11-29"}, "people": {"light": 2}}, path)
    assert json.loads(path.read_text()) == {"source": {"date": "2026-11-29"}, "people": {"light": 2}}


def test_figures_of_several_commits_name_each_once():
    runs = [("2026-11-30", "b"), ("2026-11-29", "a"), ("2026-11-30", "b")]
    sources = [{"what": "x", "date": date, "commit": commit} for date, commit in runs]
    assert joined(sources) == {"what": "x", "date": "2026-11-30", "commit": "b, a"}


def test_what_tests_recorded_is_read_from_their_report():
    report = """<testsuites><testsuite><testcase name="a"><properties>
        <property name="rig" value="Rigify, FK"/><property name="joints_deg" value="0.012345"/>
        </properties></testcase><testcase name="b"/></testsuite></testsuites>"""
    assert recorded_cases(report) == [{"rig": "Rigify, FK", "joints_deg": 0.0123}]
