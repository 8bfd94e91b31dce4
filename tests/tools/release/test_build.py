"""A release of a tiny extension: zips by Blender's own tool, their manifests, wheels, licences and repository."""

import json
import re
import tomllib
import urllib.parse
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.tests.tools.release.tiny import WANTED, write_extension, write_index
from livehand.tools.release import build, wheels
from livehand.tools.release.build import Release, blender_tool, build_release, edit_manifest, part_from_zips
from livehand.tools.release.targets import TARGETS

BY_NAME = {target.name: target for target in TARGETS}


@pytest.fixture
def release(tmp_path, monkeypatch):
    monkeypatch.setattr(build, "ROOT", write_extension(tmp_path / "source"))
    monkeypatch.setattr(wheels, "REQUIREMENTS", WANTED)
    for name in ("PIP_EXTRA_INDEX_URL", "PIP_FIND_LINKS", "PIP_CONSTRAINT"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PIP_CONFIG_FILE", "/dev/null")
    out = tmp_path / "out"
    out.mkdir()
    options = ("--no-index", f"--find-links={write_index(tmp_path / 'index')}")
    return Release(blender_tool(None), out, "https://example.org/livehand", "", options)


def manifest_of(path):
    with zipfile.ZipFile(path) as archive:
        return tomllib.loads(archive.read("blender_manifest.toml").decode()), set(archive.namelist())


@pytest.mark.slow
def test_each_zip_has_its_systems_wheels_and_the_repository_lists_them(release):
    targets = [BY_NAME["windows_x64-py311"], BY_NAME["linux_x64-py313"]]
    assert build_release(release, targets) == []
    slim, names = manifest_of(release.out / "livehand-0.2.0-slim.zip")
    assert slim["website"] == "https://example.org/livehand"
    assert slim["permissions"] == {"network": "Fetch packages"}
    assert not {"wheels", "platforms", "build"} & slim.keys()
    assert "backend/render/renderer.py" in names
    assert not [name for name in names if name.startswith(("tests/", "wheels/"))]
    windows, names = manifest_of(release.out / "repository/livehand-0.2.0-windows_x64-py311.zip")
    assert windows["platforms"] == ["windows-x64"]
    assert (windows["blender_version_min"], windows["blender_version_max"]) == ("4.2.0", "5.1.0")
    assert {name.removeprefix("./wheels/").split("-")[0] for name in windows["wheels"]} == {
        "livehand_fake",
        "livehand_for_windows",
    }
    assert {name for name in names if name.startswith("licenses/")} == {
        "licenses/livehand-fake-1.0.txt",
        "licenses/livehand-for-windows-1.0.txt",
    }
    linux, names = manifest_of(release.out / "repository/livehand-0.2.0-linux_x64-py313.zip")
    assert linux["wheels"] == ["./wheels/livehand_fake-1.0-cp313-cp313-manylinux_2_17_x86_64.whl"]
    assert linux["blender_version_min"] == "5.1.0"
    assert "blender_version_max" not in linux
    listed = json.loads((release.out / "repository" / "index.json").read_text())["data"]
    assert sorted((one["platforms"], one["python_versions"]) for one in listed) == [
        (["linux-x64"], ["3.13"]),
        (["windows-x64"], ["3.11"]),
    ]
    page = (release.out / "repository" / "index.html").read_text()
    assert "Drag the link" in page
    assert "windows_x64-py311.zip?repository=.%2Findex.json&" in page.replace("&amp;", "&")


@pytest.mark.slow
def test_a_target_without_wheels_is_told_and_the_others_are_built(release, tmp_path):
    for path in (tmp_path / "index").glob("livehand_fake-*win*"):
        path.unlink()
    (told,) = build_release(release, [BY_NAME["windows_x64-py313"], BY_NAME["macos_arm64-py313"]])
    assert told.startswith("windows_x64-py313: pip must find a wheel of every package, got: ERROR:")
    assert "livehand-fake" in told
    assert [path.name for path in (release.out / "repository").glob("*.zip")] == [
        "livehand-0.2.0-macos_arm64-py313.zip"
    ]


@pytest.mark.slow
def test_a_zip_with_a_fault_is_not_kept(release, tmp_path):
    write_extension(tmp_path / "source", **{"backend/render/renderer.py": "import livehand_nothing\n"})
    (told,) = build_release(release, [BY_NAME["linux_x64-py311"]])
    assert "livehand_nothing is imported by backend/render/renderer.py and in no wheel" in told
    assert list((release.out / "repository").glob("*.zip")) == []


def test_the_index_of_packages_goes_into_the_zip_and_to_pip(release, monkeypatch):
    asked = []
    monkeypatch.setattr(build, "collect_wheels", lambda target, folder, options: asked.append(options) or stop())
    indexed = Release(release.tool, release.out, "", "https://example.org/cpu", ("--no-index",))
    with pytest.raises(RuntimeError):
        build_release(indexed, [BY_NAME["linux_x64-py311"]])
    assert asked == [["--no-index", "--extra-index-url", "https://example.org/cpu"]]
    with zipfile.ZipFile(release.out / "livehand-0.2.0-slim.zip") as archive:
        assert archive.read("package_index.txt") == b"https://example.org/cpu\n"


def test_kernels_of_gpus_go_into_the_zip_where_their_first_use_looks_for_them(release, monkeypatch):
    ahead = pytest.importorskip("livehand.backend.compute.gpu.ahead")

    def compiled(chips, folder):
        file = folder / "surfels_1234567" / f"surfels.sm{chips[0]}.cubin"
        file.parent.mkdir(parents=True)
        file.write_bytes(b"of a chip")
        return ahead.CompiledKernels(folder, (file,), 1.0)

    monkeypatch.setattr(ahead, "compile_kernels", compiled)
    build_release(replace(release, gpu_chips=(86,)), [])
    with zipfile.ZipFile(release.out / "livehand-0.2.0-slim.zip") as archive:
        assert archive.read("backend/compute/gpu/compiled/surfels_1234567/surfels.sm86.cubin") == b"of a chip"
    assert Path(ahead.__file__).with_name("compiled") == ahead.SHIPPED


def test_a_page_may_lie_elsewhere_than_its_zips(tmp_path):
    (tmp_path / "index.json").write_text('{"version": "v1", "data": [{"archive_url": "./a-1.zip"}]}')
    link = '<a href="./a-1.zip?repository=.%2Findex.json&blender_version_min=4.2.0">a</a>'
    (tmp_path / "index.html").write_text(link)
    part_from_zips(tmp_path, "https://example.org/zips", "https://example.com/page")
    listed = json.loads((tmp_path / "index.json").read_text())
    assert listed == {"version": "v1", "data": [{"archive_url": "https://example.org/zips/a-1.zip"}]}
    (url,) = re.findall('href="(.*?)"', (tmp_path / "index.html").read_text())
    address, _, query = url.partition("?")
    assert address == "https://example.org/zips/a-1.zip"
    wanted = {"repository": ["https://example.com/page/index.json"], "blender_version_min": ["4.2.0"]}
    assert urllib.parse.parse_qs(query) == wanted


def stop():
    raise RuntimeError


def test_keys_of_a_manifest_are_set_once_and_the_other_tables_stay(tmp_path):
    path = write_extension(tmp_path) / "blender_manifest.toml"
    edit_manifest(
        path, {"website": "https://example.org", "blender_version_min": "5.1.0", "wheels": ["./wheels/ä.whl"]}
    )
    edit_manifest(path, {"website": "https://example.com"})
    text = path.read_text(encoding="utf-8")
    read = tomllib.loads(text)
    assert (read["website"], read["blender_version_min"]) == ("https://example.com", "5.1.0")
    assert read["wheels"] == ["./wheels/ä.whl"]
    assert "build" not in read
    assert "Of the table below" not in text
    assert read["permissions"] == {"network": "Fetch packages"}


def test_without_blender_the_remedy_is_named(monkeypatch):
    monkeypatch.setattr(build.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(LiveHandError, match="pip install bpy, or name --blender PROGRAM"):
        blender_tool(None)
    assert blender_tool("blender-5") == ("blender-5", "--command", "extension")
