"""Faults planted in zips of a release, each of which a user would meet: all are found, and a good zip has none."""

import zipfile

import pytest
from livehand.tests.fake_wheels import fake_wheel
from livehand.tests.tools.release.tiny import SOURCES, WANTED
from livehand.tools.release import check, wheels
from livehand.tools.release.check import faults_of, name_faults, target_of
from livehand.tools.release.targets import LINUX, MACOS, TARGETS, WINDOWS
from livehand.tools.release.wheels import Wheel, fits

WINDOWS_311 = next(target for target in TARGETS if target.name == "windows_x64-py311")
TAG = "cp311-cp311-win_amd64"


@pytest.fixture
def make(tmp_path, monkeypatch):
    """A function (sources, wheels by their arguments, lines of the manifest) -> the faults of such a zip."""
    monkeypatch.setattr(wheels, "REQUIREMENTS", WANTED)

    def faults(sources=(), given=({"name": "livehand-fake", "tag": TAG},), licences=True, **manifest):
        paths = [fake_wheel(tmp_path / "wheels", **one) for one in given]
        keys = {
            "platforms": '["windows-x64"]',
            "blender_version_min": '"4.2.0"',
            "blender_version_max": '"5.1.0"',
            "wheels": str([f"./wheels/{path.name}" for path in paths]).replace("'", '"'),
        } | manifest
        path = tmp_path / "livehand-0.2.0-windows_x64-py311.zip"
        with zipfile.ZipFile(path, "w") as archive:
            archive.writestr("blender_manifest.toml", "".join(f"{key} = {value}\n" for key, value in keys.items()))
            for name, source in (SOURCES | dict(sources)).items():
                archive.writestr(name, source)
            for wheel in paths:
                archive.write(wheel, f"wheels/{wheel.name}")
                if licences:
                    archive.writestr(f"licenses/{Wheel(wheel).name}-{Wheel(wheel).version}.txt", "MIT")
        assert target_of(path) == WINDOWS_311
        return faults_of(path, WINDOWS_311)

    return faults


def test_a_good_zip_has_no_faults(make):
    assert make() == []


RENDERER = "backend/render/renderer.py"


@pytest.mark.parametrize(
    ("sources", "fault"),
    [
        ({RENDERER: "import livehand_other"}, f"livehand_other is imported by {RENDERER} and in no wheel"),
        ({RENDERER: "def f():\n    import livehand_other.inner"}, "livehand_other is imported by"),
        ({RENDERER: "from .lost import a"}, "backend/render/lost.py is imported and not in it"),
        ({RENDERER: "from scipy import sparse"}, f"scipy is imported by {RENDERER} before a feature asks for it"),
        ({RENDERER: "def f():\n    import scipy"}, f"scipy is imported by {RENDERER} and in no wheel"),
        ({"backend/render/CON.py": ""}, "CON.py is no name in Windows"),
        ({"backend/render/Baked.py": ""}, "backend/render/baked.py is there twice but for its case"),
        ({"backend/render/what?.py": ""}, "what?.py is no name in Windows"),
    ],
)
def test_a_fault_of_the_sources_is_found(make, sources, fault):
    found = make(sources)
    assert any(fault in line for line in found), found


def test_what_a_feature_asks_for_may_be_missing(make):
    person = "def make():\n    from scipy import sparse\n"
    call = "def f():\n    from ..person import making\n"
    assert make({"backend/person/__init__.py": "", "backend/person/making.py": person, RENDERER: call}) == []


FAKE = {"name": "livehand-fake", "tag": TAG}
LONG = "/".join(["a" * 30] * 5) + ".h"


@pytest.mark.parametrize(
    ("given", "fault"),
    [
        ([], "livehand needs livehand-fake>=1, got none"),
        ([FAKE | {"version": "0.9"}], "livehand needs livehand-fake>=1, got 0.9"),
        ([FAKE | {"tag": "cp311-cp311-macosx_11_0_arm64"}], "is not for windows_x64-py311"),
        ([FAKE | {"tag": "cp313-cp313-win_amd64"}], "is not for windows_x64-py311"),
        ([FAKE | {"needs": ["other>=2"]}], "livehand-fake needs other>=2, got none"),
        ([FAKE | {"needs": ["numpy>=2"]}], "livehand-fake needs numpy>=2, got 1.24.3, 1.26.4"),
        ([FAKE, {"name": "numpy"}], "numpy is in it, beside Blender's own"),
        ([FAKE | {"files": {LONG: ""}}], f"{LONG} has {len(LONG)} letters, there is room for 135"),
        ([FAKE | {"files": {"livehand_fake/__INIT__.py": ""}}], "livehand_fake/__init__.py is there twice"),
        ([FAKE | {"files": {"livehand_fake/aux.h": ""}}], "aux.h is no name in Windows"),
    ],
)
def test_a_fault_of_the_wheels_is_found(make, given, fault):
    found = make(given=given)
    assert any(fault in line for line in found), found


def test_what_only_another_system_needs_is_no_fault(make):
    assert make(given=[FAKE | {"needs": ['other; platform_system == "Linux"', 'more; extra == "all"']}]) == []


@pytest.mark.parametrize(
    ("key", "value"), [("platforms", '["linux-x64"]'), ("blender_version_max", '"5.0.0"'), ("wheels", "[]")]
)
def test_a_wrong_manifest_is_found(make, key, value):
    (fault,) = make(**{key: value})
    assert fault.startswith(f"its {key} must be")


def test_a_missing_licence_and_a_large_zip_are_found(make, monkeypatch):
    assert make(licences=False) == ["the licence of livehand-fake is not in it"]
    monkeypatch.setattr(check, "MOST_MB", 0)
    assert make() == ["it has 0 MB, at most 0 are good"]


@pytest.mark.parametrize(
    ("tag", "fitting"),
    [
        ("py3-none-any", {"windows_x64-py311", "windows_x64-py313", "macos_arm64-py313", "linux_x64-py311"}),
        ("cp310-abi3-macosx_11_0_arm64", {"macos_arm64-py313"}),
        ("cp313-cp313-macosx_14_0_arm64", set()),
        ("cp313-cp313-macosx_12_0_arm64", {"macos_arm64-py313"}),
        ("cp311-cp311-manylinux_2_28_x86_64", {"linux_x64-py311"}),
        ("cp311-cp311-manylinux_2_34_x86_64", set()),
        ("cp311-cp311-musllinux_1_2_x86_64", set()),
        ("cp311-none-win_amd64", {"windows_x64-py311"}),
        ("py3-none-win_amd64", {"windows_x64-py311", "windows_x64-py313"}),
    ],
)
def test_a_wheel_fits_by_its_tags(tmp_path, tag, fitting):
    wheel = Wheel(fake_wheel(tmp_path, "livehand-fake", tag=tag))
    some = ("windows_x64-py311", "windows_x64-py313", "macos_arm64-py313", "linux_x64-py311")
    assert {target.name for target in TARGETS if target.name in some and fits(wheel, target)} == fitting


def test_names_are_held_to_what_each_system_takes():
    twice, reserved = ["a/B.py", "a/b.py"], ["lib/nul", "lib/com1.txt", "a ", "c."]
    assert name_faults(twice, LINUX, None) == []
    assert len(name_faults(twice, MACOS, None)) == len(name_faults(twice, WINDOWS, None)) == 1
    assert name_faults(reserved, MACOS, None) == []
    assert len(name_faults(reserved, WINDOWS, None)) == 4
