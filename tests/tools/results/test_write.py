"""Tables are written between their markers, again and again to the same text; the pages agree with their data."""

import hashlib
import json
import re
import shutil

import pytest
from livehand.backend.avatars.library import SKINS, shipped_avatar_path
from livehand.tools.results.write import DATA, PAGES, ROOT, main, read_documents, rewrite

SOURCE = {"what": "a run", "date": "2026-11-28", "commit": "abc1234"}
DOCUMENTS = {"few": {"tables": {"one": {"source": SOURCE, "columns": ["row", "dB"], "rows": [["a", 1234]]}}}}
PAGE = "# Page\n<!-- table: few.one -->\nstale\n<!-- end -->\nafter\n"
WRITTEN = """# Page
<!-- table: few.one -->
| row | dB |
| --- | ---: |
| a | 1,234 |

*a run (2026-11-28, commit abc1234).*
<!-- end -->
after
"""
MOST_WORDS = 1500  # tables included
# A number with a unit of a result; commands and tables aside, such figures come from the data alone.
FIGURE = re.compile(r"\d[\d.,]*\s?(?:%|(?:dB|ms|core-ms|core-s|MB|GB|TFLOP/s|times)\b)")


@pytest.fixture
def tree(tmp_path):
    """A copy of the pages and their data."""
    for name in PAGES:
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    shutil.copytree(ROOT / DATA, tmp_path / DATA)
    return tmp_path


def by_hand(page):
    """What a page says outside of its written tables and of code."""
    text = re.sub(r"<!-- table: .*?<!-- end -->", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    return re.sub(r"`[^`]*`|^ {4}.*$", "", text, flags=re.MULTILINE)


def test_a_table_replaces_what_stood_between_its_markers():
    assert rewrite(PAGE, DOCUMENTS) == WRITTEN


def test_writing_twice_changes_nothing():
    assert rewrite(WRITTEN, DOCUMENTS) == WRITTEN


@pytest.mark.parametrize("name", ["few.two", "many.one", "fames"])
def test_a_table_that_nothing_makes_is_an_error(name):
    with pytest.raises(ValueError, match=f"got '{name}'"):
        rewrite(PAGE.replace("few.one", name), DOCUMENTS)


@pytest.mark.parametrize("page", [PAGE.replace("<!-- end -->", ""), PAGE.replace("<!-- end -->", "") + PAGE])
def test_a_table_without_an_end_is_an_error(page):
    with pytest.raises(ValueError, match="needs an `<!-- end -->` of its own"):
        rewrite(page, DOCUMENTS)


def test_the_pages_agree_with_their_data():
    assert main(["--check"]) == 0, "run `make results`"


def test_a_figure_that_a_hand_edits_is_found_and_written_again(tree, capsys):
    page = tree / "docs/results/quality.md"
    right = page.read_text(encoding="utf-8")
    page.write_text(right.replace(" (8) |", " (7) |", 1), encoding="utf-8")
    assert page.read_text(encoding="utf-8") != right
    assert main(["--check", "--root", str(tree)]) == 1
    assert capsys.readouterr().out == "out of date: docs/results/quality.md\n"
    assert main(["--root", str(tree)]) == 0
    assert page.read_text(encoding="utf-8") == right


def test_new_data_makes_the_pages_stale(tree):
    path = tree / DATA / "against_cycles.json"
    document = json.loads(path.read_text(encoding="utf-8"))
    document["tables"]["psnr"]["rows"][1][1] = "35.9 (99)"
    path.write_text(json.dumps(document), encoding="utf-8")
    assert main(["--check", "--root", str(tree)]) == 1


@pytest.mark.parametrize("name", PAGES)
def test_no_figure_is_typed_by_hand(name):
    assert FIGURE.findall(by_hand(ROOT / name)) == []


@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_short(name):
    words = [word for word in (ROOT / name).read_text(encoding="utf-8").split() if re.search(r"\w", word)]
    assert len(words) <= MOST_WORDS


def test_the_headers_are_those_of_the_avatars_that_ship():
    people = read_documents(ROOT / DATA)["avatars"]["people"]
    shipped = {skin: hashlib.sha256(shipped_avatar_path(skin).read_bytes()).hexdigest() for skin in SKINS}
    assert {skin: one["sha256"] for skin, one in people.items()} == shipped, "run `make results`"


def test_every_document_says_where_it_is_from():
    for name, document in read_documents(ROOT / DATA).items():
        sources = [table["source"] for table in document.get("tables", {}).values()] or [document["source"]]
        for source in sources:
            assert set(source) == {"what", "date", "commit"}, name
            assert all(source.values()), name
