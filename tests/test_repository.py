"""What enters git: no file over 500 kB but those that `assets.lock` lists, as it lists them."""

import hashlib
import shutil
import subprocess

import pytest
from livehand.tools.assets_lock import LIMIT_BYTES, LOCK, ROOT, find_faults, main, read_lock

pytestmark = pytest.mark.skipif(shutil.which("git") is None, reason="needs git")


def git(folder, *arguments):
    subprocess.run(["git", *arguments], cwd=folder, check=True, capture_output=True)


@pytest.fixture
def repository(tmp_path):
    """A repository with a large file that is listed and a small one."""
    git(tmp_path, "init", "-q")
    (tmp_path / "large.bin").write_bytes(bytes(LIMIT_BYTES + 1))
    (tmp_path / "small.bin").write_bytes(bytes(LIMIT_BYTES))
    git(tmp_path, "add", ".")
    assert main(["--update", "--root", str(tmp_path)]) == 0
    return tmp_path


@pytest.mark.skipif(not (ROOT / ".git").exists(), reason="needs a clone")
def test_no_large_file_is_in_git_that_the_list_does_not_hold():
    assert find_faults(ROOT) == []


def test_the_list_has_hash_size_and_path_of_what_is_over_the_limit(repository):
    content = bytes(LIMIT_BYTES + 1)
    assert (repository / LOCK).read_text() == f"{hashlib.sha256(content).hexdigest()} {LIMIT_BYTES + 1} large.bin\n"
    assert find_faults(repository) == []


def test_a_new_large_file_is_refused_until_it_is_listed(repository, capsys):
    (repository / "new.bin").write_bytes(bytes(LIMIT_BYTES + 2))
    assert find_faults(repository) == []  # git does not track it yet
    git(repository, "add", "new.bin")
    (fault,) = find_faults(repository)
    assert fault.startswith("new.bin must have at most 500,000 bytes or stand in assets.lock, got 500,002: ")
    assert main(["--root", str(repository), "small.bin", "new.bin"]) == 1
    assert "new.bin must have" in capsys.readouterr().err
    assert main(["--root", str(repository), "small.bin", "large.bin"]) == 0
    assert main(["--update", "--root", str(repository)]) == 0
    assert [asset.path for asset in read_lock(repository)] == ["large.bin", "new.bin"]


def test_another_content_of_a_listed_file_is_refused(repository):
    (repository / "large.bin").write_bytes(b"\1" * (LIMIT_BYTES + 1))
    (fault,) = find_faults(repository)
    assert fault.startswith("large.bin must be the file that assets.lock lists (")


def test_a_listed_file_that_is_gone_is_told(repository):
    git(repository, "rm", "-q", "--cached", "large.bin")
    (fault,) = find_faults(repository)
    assert fault.startswith("large.bin stands in assets.lock and must be tracked by git, got none: ")


def test_a_malformed_line_is_an_error(repository):
    (repository / LOCK).write_text("abc large.bin\n")
    with pytest.raises(ValueError, match=r"assets\.lock, line 1 must be `SHA-256 BYTES PATH`, got 'abc large\.bin'"):
        find_faults(repository)


def test_the_pre_commit_hook_runs_the_check():
    hooks = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    assert "entry: .venv/bin/python tools/assets_lock.py" in hooks


def test_the_readme_fits_a_screen_or_two():
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 70
