"""Rules that keep the house as it was drawn: sizes of modules and rooms, names, and imperative docstrings.

What broke a rule when it was made stands in `rules_baseline.json`, and in `d401_baseline.txt` for docstrings. Both only
shrink: a new fault fails, and so does an entry that is a fault no more. After a move, or when faults are gone:

    python -m livehand.tests.test_rules

writes both anew, and refuses if a rule has more faults than before. The last tests plant faults and see them found.
"""

import ast
import json
import re
import subprocess
import sys
from collections import Counter
from importlib.util import find_spec
from pathlib import Path

import pytest
from livehand.tests.test_layers import HALVES, ROOT, imports, modules, plant, room_of

TESTS = Path(__file__).parent
BASELINE, D401_BASELINE = TESTS / "rules_baseline.json", TESTS / "d401_baseline.txt"
PRODUCT = (*HALVES, "tools")

SHORTEST, LONGEST = 40, 400
ALONE = 80  # a shorter module that one other of its room imports belongs into that
FOLDERS_OF_ONES = {"formats", "importers", "writers"}  # one module each, however short
MOST_IN_A_FOLDER, MOST_OF_A_NAME, MOST_OF_A_WORD = 25, 2, 8
STEMS = {
    "seen_": r"(^|_)seen_",
    "known_": r"(^|_)known_",
    **{word: rf"(^|_){word}(_|$)" for word in ("shed", "places", "told", "strays", "afar")},
}
OF_OTHERS = {"parse_known_args"}
WORDS = ("Skin", "Surface", "Light")


def lines_of(root):
    """Module -> its number of lines; packages' own files and programs' first ones are no modules here."""
    return {
        name: len(path.read_text(encoding="utf-8").splitlines())
        for name, path in modules(root).items()
        if path.stem not in ("__init__", "__main__")
    }


def stands_alone(name):
    """Whether a module may be short: a format, an importer or a command."""
    *folders, stem = name.split(".")
    return bool(FOLDERS_OF_ONES & set(folders)) or stem.endswith("command")


def short_modules(root):
    return [name for name, count in lines_of(root).items() if count < SHORTEST and not stands_alone(name)]


def long_modules(root):
    return [name for name, count in lines_of(root).items() if count > LONGEST]


def single_importers(root):
    """Short modules that just one other imports, of the same room."""
    known, lines = modules(root), lines_of(root)
    importers = {name: set() for name in known}
    for name, path in known.items():
        for imported in imports(name, path, known)[0] & known.keys():
            importers[imported].add(name)
    return [
        name
        for name, count in lines.items()
        if count < ALONE
        and not stands_alone(name)
        and len(importers[name]) == 1
        and {room_of(one, known[one]) for one in importers[name]} == {room_of(name, known[name])}
    ]


def crowded_folders(root):
    """Folder -> modules in it, where they are too many."""
    folders = Counter(name.rpartition(".")[0] for name in lines_of(root))
    return {folder: count for folder, count in folders.items() if count > MOST_IN_A_FOLDER}


def common_names(root):
    """File name -> how many modules have it, where they are too many."""
    names = Counter(name.rpartition(".")[2] for name in lines_of(root))
    return {name: count for name, count in names.items() if count > MOST_OF_A_NAME and name != "command"}


def forbidden_stems(root):
    """The identifiers and modules that have a word which is no term of the field."""
    names = {name.rpartition(".")[2] for name in modules(root)}
    for path in modules(root).values():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names |= {getattr(node, field) for field in ("id", "attr", "arg", "name", "asname") if hasattr(node, field)}
    patterns = [re.compile(pattern) for pattern in STEMS.values()]
    return [name for name in names - {None, *OF_OTHERS} if any(pattern.search(snake(name)) for pattern in patterns)]


def snake(name):
    """`SeenHand` and `SEEN_HAND` as `seen_hand`."""
    return re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()


def common_words(root):
    """Word -> the classes whose names have it, where they are too many."""
    classes = [
        node.name
        for path in modules(root).values()
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
    ]
    words = Counter(word for name in classes for word in {one.removesuffix("s") for one in camel_words(name)})
    return {word: words[word] for word in WORDS if words[word] > MOST_OF_A_WORD}


def camel_words(name):
    return re.findall(r"[A-Z][a-z0-9]*", name)


RULES = {
    "short_modules": short_modules,
    "long_modules": long_modules,
    "single_importers": single_importers,
    "crowded_folders": crowded_folders,
    "common_names": common_names,
    "forbidden_stems": forbidden_stems,
    "common_words": common_words,
}


def d401(root):
    """File -> first lines of docstrings that are not imperative."""
    command = [sys.executable, "-m", "ruff", "check", "--select", "D401", "--output-format", "json", "--no-cache"]
    folders = [name for name in PRODUCT if (root / name).is_dir()]
    config = ["--isolated", "--config", "lint.pydocstyle.convention='google'"]
    done = subprocess.run([*command, *config, *folders], cwd=root, capture_output=True, text=True)
    assert done.returncode in (0, 1), done.stderr
    found = (Path(one["filename"]).relative_to(root.resolve()).as_posix() for one in json.loads(done.stdout))
    return dict(sorted(Counter(found).items()))


def read_d401_baseline():
    pairs = (line.rsplit(" ", 1) for line in D401_BASELINE.read_text(encoding="utf-8").splitlines())
    return {path: int(count) for path, count in pairs}


def differences(found, baseline):
    """What is new and what is no more, in words; the numbers of a dict may neither grow nor stay behind."""
    found, baseline = (Counter(one if isinstance(one, dict) else dict.fromkeys(one, 1)) for one in (found, baseline))
    new = [f"{name}: {found[name]}, at most {baseline[name]}" for name in found - baseline]
    gone = [f"{name} is better now; python -m livehand.tests.test_rules" for name in baseline - found]
    return sorted(new) + sorted(gone)


@pytest.mark.slow
@pytest.mark.parametrize("rule", RULES)
def test_no_rule_is_broken_anew_and_the_baseline_shrinks(rule):
    assert differences(RULES[rule](ROOT), json.loads(BASELINE.read_text(encoding="utf-8"))[rule]) == []


@pytest.mark.skipif(find_spec("ruff") is None, reason="needs ruff")
def test_first_lines_of_docstrings_become_imperative():
    assert differences(d401(ROOT), read_d401_baseline()) == []


def test_a_baseline_only_shrinks():
    assert differences(["a", "b"], ["a", "b"]) == []
    assert differences(["a", "c"], ["a"]) == ["c: 1, at most 0"]
    assert differences(["a"], ["a", "b"]) == ["b is better now; python -m livehand.tests.test_rules"]
    assert differences({"a": 3}, {"a": 2}) == ["a: 3, at most 2"]
    assert len(differences({"a": 1}, {"a": 2})) == 1


LONG, FINE = "x = 1\n" * (LONGEST + 1), "x = 1\n" * SHORTEST
USER = FINE + "from .part import x\n"


@pytest.mark.parametrize(
    ("rule", "files", "fault"),
    [
        ("short_modules", {"backend/hand/model.py": "x = 1\n" * (SHORTEST - 1)}, "backend.hand.model"),
        ("long_modules", {"backend/hand/model.py": LONG}, "backend.hand.model"),
        ("single_importers", {"backend/hand/model.py": USER, "backend/hand/part.py": FINE}, "backend.hand.part"),
        ("crowded_folders", {f"backend/hand/m{k}.py": FINE for k in range(MOST_IN_A_FOLDER + 1)}, "backend.hand"),
        ("common_names", {f"backend/{room}/light.py": FINE for room in ("hand", "image", "field")}, "light"),
        ("forbidden_stems", {"backend/hand/model.py": "def f(*, seen_by): ..."}, "seen_by"),
        ("forbidden_stems", {"livehand_blender/rig/model.py": "class KnownSkin: ..."}, "KnownSkin"),
        ("forbidden_stems", {"tools/model.py": "x.light_shed = 1"}, "light_shed"),
        ("forbidden_stems", {"backend/hand/places.py": ""}, "places"),
        ("common_words", {"backend/hand/model.py": "".join(f"class Skin{k}: ...\n" for k in "ABCDEFGHI")}, "Skin"),
    ],
)
def test_planted_faults_are_found(tmp_path, rule, files, fault):
    assert list(RULES[rule](plant(tmp_path, files))) == [fault]


@pytest.mark.parametrize(
    ("rule", "files"),
    [
        (
            "short_modules",
            {"backend/motion/formats/x.py": "", "backend/hand/fit_command.py": "", "backend/hand/__init__.py": ""},
        ),
        ("long_modules", {"backend/hand/model.py": "x = 1\n" * LONGEST}),
        ("single_importers", {"backend/hand/model.py": USER, "backend/hand/part.py": "x = 1\n" * ALONE}),
        ("single_importers", {"backend/field/m.py": "from ..hand.part import x", "backend/hand/part.py": FINE}),
        ("crowded_folders", {f"backend/hand/{k % 2 * 'deep/'}m{k}.py": FINE for k in range(MOST_IN_A_FOLDER + 1)}),
        ("common_names", {f"backend/{room}/command.py": FINE for room in ("hand", "image", "field")}),
        ("forbidden_stems", {"backend/hand/model.py": "is_seen = unknown = replaces = 1"}),
        ("common_words", {"backend/hand/model.py": "".join(f"class Skin{k}: ...\n" for k in "ABCDEFGH")}),
    ],
)
def test_what_keeps_a_rule_is_no_fault(tmp_path, rule, files):
    assert list(RULES[rule](plant(tmp_path, files))) == []


@pytest.mark.skipif(find_spec("ruff") is None, reason="needs ruff")
def test_a_docstring_that_is_not_imperative_is_found(tmp_path):
    plant(
        tmp_path, {"backend/hand/model.py": 'def f():\n    """The hand."""\n\n\ndef g():\n    """Return the hand."""\n'}
    )
    assert d401(tmp_path) == {"backend/hand/model.py": 1}


def write_baselines():
    """Write what is a fault today, unless a rule has more of them than before."""
    old = json.loads(BASELINE.read_text(encoding="utf-8")) if BASELINE.is_file() else None
    new = {rule: sorted_faults(find(ROOT)) for rule, find in RULES.items()}
    docstrings = d401(ROOT)
    sums = {rule: total(faults) for rule, faults in new.items()} | {"D401": total(docstrings)}
    if old:
        before = {rule: total(faults) for rule, faults in old.items()} | {"D401": total(read_d401_baseline())}
        grown = [f"{rule}: {count}, before {before[rule]}" for rule, count in sums.items() if count > before[rule]]
        if grown:
            sys.exit("a rule is broken more often than before: " + "; ".join(grown))
    BASELINE.write_text(json.dumps(new, indent=1) + "\n", encoding="utf-8", newline="\n")
    text = "".join(f"{path} {count}\n" for path, count in docstrings.items())
    D401_BASELINE.write_text(text, encoding="utf-8", newline="\n")
    sys.stdout.write("".join(f"{rule}: {count}\n" for rule, count in sums.items()))


def sorted_faults(faults):
    return dict(sorted(faults.items())) if isinstance(faults, dict) else sorted(faults)


def total(faults):
    return sum(faults.values()) if isinstance(faults, dict) else len(faults)


if __name__ == "__main__":
    write_baselines()
