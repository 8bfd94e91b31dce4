"""An avatar from pictures in Blender: who wears it afterwards, what errors leave, and the process itself."""

import shutil
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from livehand.backend.avatars.library import shipped_avatar_path
from livehand.backend.person.command import start_person
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system.command import parse_fov
from livehand.backend.system.packages import Requirement
from livehand.livehand_blender.render.hand_source import hand_source
from livehand.livehand_blender.rig.hand import active_hand
from livehand.livehand_blender.ui import mixins, packages, person
from livehand.tests.blender.test_panels import Layout, clipped


class FakeJob(SimpleNamespace):
    """Ends at once, with an avatar or an error."""

    started = None

    def wait(self):
        if "error" not in self.report:
            shutil.copy(shipped_avatar_path("middle"), self.output)

    def result(self):
        if "error" in self.report:
            raise LiveHandError(self.report["error"])
        return self.report


@pytest.fixture
def ends_with(hand_scene, tmp_path, monkeypatch):
    """A function: what the job reports."""
    monkeypatch.setattr(mixins, "missing_requirements", lambda: [])
    monkeypatch.setattr(mixins, "has_networks", lambda: True)
    monkeypatch.setattr(person, "library_folder", lambda context: tmp_path)

    def ends(report):
        def start(arguments):
            FakeJob.started = arguments
            return FakeJob(output=Path(arguments[arguments.index("-o") + 1]), report=report)

        monkeypatch.setattr(person, "start_person", start)

    return ends


def make(**settings):
    return bpy.ops.livehand.person_from_pictures("EXEC_DEFAULT", **settings)


def test_the_active_hand_wears_the_new_avatar(ends_with, tmp_path):
    ends_with({"seen": 0.7, "notes": []})
    told = {"person_name": "Anna", "consent": "yes", "side": "left", "length_mm": 188.0, "field_of_view": 1.1}
    assert make(filepath="/film.mp4", **told) == {"FINISHED"}
    assert hand_source(active_hand(bpy.context)).avatar_path == tmp_path / "Anna.safetensors"
    arguments = FakeJob.started
    assert Path(arguments[0]).name == "film.mp4"
    assert arguments[arguments.index("--side") + 1] == "left"
    assert arguments[arguments.index("--consent") + 1] == "yes"
    assert float(arguments[arguments.index("--length-mm") + 1]) == 188
    assert float(arguments[arguments.index("--fov") + 1]) == pytest.approx(np.rad2deg(1.1), abs=1e-3)


@pytest.mark.parametrize(("given_deg", "told_deg"), [(0.0, None), (0.3, 1.0), (1.0, 1.0), (200.0, 170.0)])
def test_the_angle_of_view_is_unknown_or_one_that_the_command_takes(ends_with, given_deg, told_deg):
    ends_with({"seen": 0.7, "notes": []})
    make(filepath="/film.mp4", field_of_view=np.deg2rad(given_deg))
    arguments = FakeJob.started
    assert ("--fov" in arguments) == (told_deg is not None)
    assert told_deg is None or parse_fov(arguments[arguments.index("--fov") + 1]) == pytest.approx(told_deg)


def test_a_person_is_adjusted_by_what_is_switched_on(ends_with, tmp_path, monkeypatch):
    ends_with({})
    monkeypatch.setattr(person, "start_adjusting", person.start_person)
    assert bpy.ops.livehand.adjust_person("EXEC_DEFAULT", tone=0.7, with_tone=True, hair=2.0) == {"FINISHED"}
    assert FakeJob.started[FakeJob.started.index("--tone") :] == ["--tone", "0.7"]
    assert hand_source(active_hand(bpy.context)).avatar_path.parent == tmp_path


def test_a_name_that_is_taken_gets_a_number(ends_with, tmp_path):
    (tmp_path / "Anna.safetensors").touch()
    ends_with({"seen": 0.7, "notes": []})
    make(filepath="//film.mp4", person_name="Anna")
    assert hand_source(active_hand(bpy.context)).avatar_path == tmp_path / "Anna_2.safetensors"


def test_a_photograph_stands_for_its_folder(ends_with, tmp_path):
    (tmp_path / "photos").mkdir()
    ends_with({"seen": 0.7, "notes": []})
    make(filepath=str(tmp_path / "photos" / "one.jpg"))
    assert FakeJob.started[0] == str(tmp_path / "photos")


def test_an_error_changes_nothing(ends_with, tmp_path):
    before = hand_source(active_hand(bpy.context)).avatar_path
    ends_with({"error": "a film must show a hand, got none"})
    with pytest.raises(RuntimeError, match="must show a hand"):
        make(filepath="//film.mp4")
    assert hand_source(active_hand(bpy.context)).avatar_path == before
    assert not list(tmp_path.glob("*.safetensors"))


def test_where_its_packages_are_missing_one_button_offers_them_without_a_warning(hand_scene, monkeypatch):
    missing = (Requirement("livehand_missing_package", "livehand-missing-package>=1", 12),)
    monkeypatch.setattr(person, "missing_of", lambda requirements: missing)
    monkeypatch.setattr(packages, "missing_of", lambda requirements: missing)
    monkeypatch.setattr(packages.RunningTask, "now", None)
    layout = Layout([])
    person.draw_person(layout, bpy.context)
    assert layout.drawn[-2:] == ["livehand.install_packages", "PICTURES"]
    assert layout.parts[-1:] == [("Film or Photographs (12 MB)", True)]
    assert list(clipped(layout)) == []


def test_the_process_reports_the_commands_error(tmp_path):
    job = start_person([str(tmp_path / "none"), "-o", str(tmp_path / "out.safetensors")])
    job.wait()
    assert not job.is_running
    with pytest.raises(LiveHandError, match="must be a film"):
        job.result()


def test_a_process_that_is_canceled_ends(tmp_path):
    job = start_person([str(tmp_path / "none"), "-o", str(tmp_path / "out.safetensors")])
    job.cancel()
    job.wait()
    with pytest.raises(LiveHandError):
        job.result()


def test_a_new_person_is_worn_and_has_the_numbers(hand_scene, tmp_path, monkeypatch):
    monkeypatch.setattr(person, "library_folder", lambda context: tmp_path)
    started = []

    def start(arguments):
        started.append(arguments)
        return FakeJob(output=Path(arguments[arguments.index("-o") + 1]), report={})

    monkeypatch.setattr(person, "start_new_person", start)
    assert bpy.ops.livehand.new_person("EXEC_DEFAULT", seed=12, age=70, hair=0.5) == {"FINISHED"}
    assert hand_source(active_hand(bpy.context)).avatar_path == tmp_path / "Person_12.safetensors"
    arguments = dict(zip(started[0][::2], started[0][1::2], strict=True))
    assert (arguments["--seed"], arguments["--age"], arguments["--hair"]) == ("12", "70.0", "0.5")
    assert arguments["--name"] == "Person 12"
    assert {f"--{name}" for name in person.NUMBERS} < arguments.keys()


def test_sliders_end_where_numbers_do():
    properties = bpy.ops.livehand.new_person.get_rna_type().properties
    for name, spec in person.NUMBERS.items():
        assert properties[name].hard_min == pytest.approx(spec.low)
        assert properties[name].hard_max == pytest.approx(spec.high)
