"""The documentation fits the tree and itself: links, paths, options, rooms, length, and no figures of runs."""

import argparse
import re
import runpy
from pathlib import Path

import pytest
from livehand.livehand_blender.cli import COMMANDS

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
MANUALS = sorted(page for page in DOCS.rglob("*.md") if page.relative_to(DOCS).parts[0] in ("use", "make", "dev"))
PAGES = sorted([*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")), *DOCS.rglob("*.md")])
# A changelog names files as they were.
CURRENT = [page for page in PAGES if page.name != "CHANGELOG.md"]
MOST_WORDS, MOST_WORDS_TO_USE, MOST_WORDS_IN_ALL = 1500, 1200, 28_000

LINK = re.compile(r"\]\(([^)\s]+)\)")
DOCS_PAGE = re.compile(r"\bdocs/[\w/-]+\.(?:md|png|webp|jpg)\b")
MODULE = re.compile(r"\b(?:backend|livehand_blender|tests|examples|tools)/[\w/.-]*\w\.(?:py|npz|yaml|js|blend|json)\b")
# A folder stands alone in backticks, with or without a slash at its end.
FOLDER = re.compile(r"`((?:backend|livehand_blender|tests|tools|examples)/[\w/-]*)`")
# What a run gave: a number with one of these units, or a metric and a number. Limits and settings have other units.
RESULT = re.compile(
    r"\d\s*(?:dB\b|ms\b|core-\w+|processor-\w+|(?:pictures|images) a second|TFLOP|GB/s|Mpix)"
    r"|(?:PSNR|SSIM|LPIPS|FLIP|IoU)\b(?: (?:is|of|was|at))? \d"
    r"|\b(?:busy|idle|quiet|shared) (?:cores?|machine)\b"
    r"|\b(?:it was|were|we|as) measured\b|\btried\b"
)


def page_id(page):
    return str(page.relative_to(ROOT))


def prose_of(page):
    """A page without its code blocks, whose brackets are no links."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def words_of(page):
    """The number of words of a page: what holds a letter or a digit, so no rules of tables; without written tables."""
    text = re.sub(r"<!-- table: .*?<!-- end -->", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    return sum(bool(re.search(r"\w", word)) for word in text.split())


def results_in(text):
    return [match.group() for match in RESULT.finditer(" ".join(text.split()))]


def options_of(command):
    """The options of a command, each as the tuple of its spellings, without those that its help does not show."""
    parser = argparse.ArgumentParser(add_help=False)
    command.add_arguments(parser)
    return [action.option_strings for action in parser._actions if action.help != argparse.SUPPRESS]


def is_shown(option, text):
    """Whether a text has one of the spellings of an option (or of an argument, which has none)."""
    return not option or any(re.search(rf"(?<![\w-]){re.escape(name)}(?![\w-])", text) for name in option)


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_relative_link_resolves(page):
    targets = {link.partition("#")[0] for link in LINK.findall(prose_of(page)) if "://" not in link}
    assert sorted(target for target in targets if target and not (page.parent / target).exists()) == []


@pytest.mark.parametrize("page", CURRENT, ids=page_id)
def test_every_named_path_exists(page):
    text = page.read_text(encoding="utf-8")
    named = {*MODULE.findall(text), *DOCS_PAGE.findall(text), *FOLDER.findall(text)}
    assert sorted(path for path in named if not (ROOT / path).exists()) == []


def test_links_and_paths_are_found():
    assert LINK.findall("[a](b.md#c)") == ["b.md#c"]
    assert MODULE.findall("see `backend/a/b.py` and tests/c.py") == ["backend/a/b.py", "tests/c.py"]
    assert FOLDER.findall("`backend/motion/formats/`, `backend/light`") == ["backend/motion/formats/", "backend/light"]


@pytest.mark.parametrize("page", MANUALS, ids=page_id)
def test_a_page_is_short(page):
    assert words_of(page) <= (MOST_WORDS_TO_USE if page.parent.name == "use" else MOST_WORDS)


def test_all_pages_together_are_short():
    assert sum(words_of(page) for page in DOCS.rglob("*.md")) <= MOST_WORDS_IN_ALL


@pytest.mark.parametrize("page", MANUALS, ids=page_id)
def test_figures_of_runs_stand_in_results_alone(page):
    assert results_in(prose_of(page)) == []


@pytest.mark.parametrize(
    "text",
    [
        "36.0 dB",
        "82 ms a frame",
        "15 pictures a\nsecond",
        "FLIP of 0.03",
        "an IoU of 0.97",
        "one busy core",
        "it was measured",
    ],
)
def test_a_figure_of_a_run_is_seen(text):
    assert results_in(text)


@pytest.mark.parametrize(
    "text", ["-10 log10 of the error, dB", "every 15 seconds", "3 mm", "128 to 512 px", "24 a second"]
)
def test_limits_and_settings_are_no_figures_of_runs(text):
    assert results_in(text) == []


@pytest.mark.parametrize("name", COMMANDS)
def test_every_option_stands_in_a_page(name):
    pages = [page.read_text(encoding="utf-8") for page in DOCS.rglob("*.md")]
    of_command = " ".join(text for text in pages if re.search(rf"livehand {name}\b|`{name}`", text))
    assert of_command, f"no page shows livehand {name}"
    assert [option for option in options_of(COMMANDS[name]) if not is_shown(option, of_command)] == []


def test_architecture_shows_the_rooms_in_their_rows():
    rows = re.findall(
        r"^\| (\d+) \| (.*?) ?\| (.*?) ?\|$", (DOCS / "dev/architecture.md").read_text("utf-8"), re.MULTILINE
    )
    shown = [
        {
            f"{half}.{room}"
            for half, cell in zip(("backend", "livehand_blender"), cells, strict=True)
            for room in re.findall(r"\*\*(\w+)\*\*", cell)
        }
        for number, *cells in rows
        if number.isdigit()
    ]
    rooms = runpy.run_path(str(ROOT / "tests/test_layers.py"))["ROWS"]
    assert shown == [set(row) - {"livehand_blender", "tools"} for row in rooms]


def test_the_site_has_every_page():
    nav = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert (
        sorted(str(page.relative_to(DOCS)) for page in DOCS.rglob("*.md") if str(page.relative_to(DOCS)) not in nav)
        == []
    )
