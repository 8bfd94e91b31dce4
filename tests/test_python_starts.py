"""Every Python that is started leaves the current folder's modules alone: Blender's is often the .blend's folder."""

import ast
import re
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
STARTING = [
    *ROOT.glob("*.py"),
    *(path for name in ("backend", "livehand_blender", "examples") for path in (ROOT / name).rglob("*.py")),
]
# Repeats the command line that this process was started with, in the same folder.
EXEMPT = {"backend/batch/workers.py": 1}


def unsafe_starts(source):
    """Lines in which `sys.executable` is not followed by -P or -I, in a list or in a text."""
    tree = ast.parse(source)
    safe = set()
    for node in ast.walk(tree):
        parts = node.elts if isinstance(node, ast.List | ast.Tuple) else []
        parts = node.values if isinstance(node, ast.JoinedStr) else parts
        for part, following in pairwise(parts):
            named = part.value if isinstance(part, ast.FormattedValue) else part
            text = following.value if isinstance(following, ast.Constant) else ""
            if re.match(r'"?\s*(-P|-I)(\s|$)', str(text)):
                safe.add(id(named))
    starts = (node for node in ast.walk(tree) if isinstance(node, ast.Attribute))
    return [one.lineno for one in starts if ast.unparse(one) == "sys.executable" and id(one) not in safe]


@pytest.mark.parametrize(
    ("source", "lines"),
    [
        ('[sys.executable, "-m", "pip"]', [1]),
        ('[sys.executable, "-P", "-m", "pip"]', []),
        ("\nrun([sys.executable, script])", [2]),
        ("f'\"{sys.executable}\" -m pip'", [1]),
        ("f'\"{sys.executable}\" -I -m pip'", []),
        ("python = sys.executable", [1]),
    ],
)
def test_planted_starts_are_found(source, lines):
    assert unsafe_starts(source) == lines


@pytest.mark.slow
def test_every_start_of_a_python_is_safe():
    found = {str(path.relative_to(ROOT)): unsafe_starts(path.read_text(encoding="utf-8")) for path in STARTING}
    assert {name: len(lines) for name, lines in found.items() if lines} == EXEMPT, found
    assert len(STARTING) > 300


@pytest.mark.slow
def test_no_python_is_started_by_its_name():
    """As in `python -m pip`, which the system looks up, on Windows in the current folder first."""
    for path in STARTING:
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.List | ast.Tuple) and node.elts and isinstance(node.elts[0], ast.Constant):
                assert not re.fullmatch(r"python[\d.]*(\.exe)?", str(node.elts[0].value)), (path, node.lineno)
