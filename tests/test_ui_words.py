"""What Blender's users read has Blender's own words: lights, not lamps, and American spelling."""

import ast
import re
from pathlib import Path

import livehand
import pytest

BLENDER_SIDE = Path(livehand.__path__[0]) / "livehand_blender"
WORDS = re.compile(r"\b(lamps?|colours?|grey|licences?|centres?|(?:milli|centi)?metres?|behaviour)\b", re.I)


def texts_of(source):
    """Sentences and labels of a module: strings of two words, or with a capital, that are no docstrings."""
    tree = ast.parse(source)
    docs = {
        id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in docs:
            if " " in node.value.strip() or node.value[:1].isupper():
                yield node.lineno, node.value


@pytest.mark.parametrize(
    "path", sorted(BLENDER_SIDE.rglob("*.py")), ids=lambda path: path.relative_to(BLENDER_SIDE).as_posix()
)
def test_texts_have_blenders_words(path):
    found = [f"{line}: {text}" for line, text in texts_of(path.read_text(encoding="utf-8")) if WORDS.search(text)]
    assert found == []


def test_other_words_are_seen():
    docstring = '"""Lamps."""\n'
    source = (
        docstring
        + 'label, name = "No lamp: hands are dark", "lamp"\ntext = f"{1} other colour"\ngood = "Light\'s color"'
    )
    assert [text for _, text in texts_of(source) if WORDS.search(text)] == ["No lamp: hands are dark", " other colour"]
