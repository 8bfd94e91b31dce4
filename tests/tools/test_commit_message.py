"""The hook for commit messages: `scope: imperative`, at most 72 characters."""

import subprocess
import sys

import pytest
from livehand.tools.assets_lock import ROOT
from livehand.tools.commit_message import LONGEST, find_faults, main

GOOD = "light: read lamps once"


@pytest.mark.parametrize(
    "message",
    [
        GOOD,
        f"{GOOD}\n\nThey were read 8 times a frame.\n# Please enter the commit message\n",
        "backend/light: embed the sky\n",
        "docs, tools: need no second pass",
        "light: " + "x" * (LONGEST - 7),
        "Merge branch 'light' into main, with a subject that is longer than seventy-two characters are\n",
        "fixup! light: read lamps once",
    ],
)
def test_what_follows_the_rule_passes(message):
    assert find_faults(message) == []


@pytest.mark.parametrize(
    ("message", "fault"),
    [
        ("", "must be `scope: imperative`"),
        ("Read lamps once", "must be `scope: imperative`"),
        ("Light: read lamps once", "must be `scope: imperative`"),
        ("light:read lamps once", "must be `scope: imperative`"),
        ("light: added lamps", "a verb as in an order, such as `add`, got 'added'"),
        ("light: reading lamps", "got 'reading'"),
        ("light: fixes lamps", "got 'fixes'"),
        ("light: the lamps of a frame", "got 'the'"),
        ("light: " + "x" * (LONGEST - 6), "at most 72 characters, got 73"),
        (f"{GOOD}.", "no full stop"),
        (f"{GOOD}\nThey were read 8 times a frame.", "the line after the subject must be empty"),
    ],
)
def test_what_breaks_it_is_named(message, fault):
    (found,) = find_faults(message)
    assert fault in found


def test_git_is_stopped_by_the_exit_code(tmp_path, capsys):
    file = tmp_path / "COMMIT_EDITMSG"
    file.write_text(f"{GOOD}\n", encoding="utf-8")
    assert main([str(file)]) == 0
    file.write_text("lamps", encoding="utf-8")
    assert main([str(file)]) == 1
    assert capsys.readouterr().err.startswith("commit message: the subject must be")


def test_the_hook_runs_the_script_on_commit_messages():
    """As pre-commit does: the file's name is its only argument."""
    text = (ROOT / ".pre-commit-config.yaml").read_text(encoding="utf-8")
    entry = text[text.index("id: commit-message") :]
    assert "entry: .venv/bin/python tools/commit_message.py\n" in entry
    assert "stages: [commit-msg]" in entry
    assert "default_install_hook_types: [pre-commit, commit-msg]" in text
    done = subprocess.run([sys.executable, str(ROOT / "tools/commit_message.py"), "/dev/stdin"], input=b"lamps")
    assert done.returncode == 1
