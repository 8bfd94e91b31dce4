"""The documentation is consistent with the tree: links, paths of modules, and the version in CITATION.cff."""

import re
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PAGES = sorted([*(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")), *ROOT.glob("docs/*.md")])
LINK = re.compile(r"\]\(([^)\s]+)\)")
MODULE = re.compile(r"\b(?:backend|livehand_blender|tests|examples)/[\w/]+\.py\b")
DOCS_PAGE = re.compile(r"\bdocs/[\w/]+\.(?:md|png|webp)\b")


def page_id(page):
    return str(page.relative_to(ROOT))


def prose_of(page):
    """A page without its code blocks, whose brackets are no links."""
    return re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_relative_link_resolves(page):
    targets = {link.partition("#")[0] for link in LINK.findall(prose_of(page)) if "://" not in link}
    assert sorted(target for target in targets if target and not (page.parent / target).exists()) == []


@pytest.mark.parametrize("page", PAGES, ids=page_id)
def test_every_named_path_exists(page):
    text = page.read_text(encoding="utf-8")
    named = {*MODULE.findall(text), *DOCS_PAGE.findall(text)}
    assert sorted(path for path in named if not (ROOT / path).is_file()) == []


def test_the_readme_cites_both_papers():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert {"mundra2023livehand", "romero2017embodied"} <= set(re.findall(r"^@\w+\{(\w+),$", text, re.MULTILINE))


def test_the_citation_parses_and_has_the_version_of_the_manifest():
    # Read as text: yaml is not a dependency. Lines of the top level begin at the margin.
    lines = (ROOT / "CITATION.cff").read_text(encoding="utf-8").splitlines()
    top = dict(line.split(":", 1) for line in lines if re.match(r"[a-z-]+:", line))
    assert {"cff-version", "message", "title", "type", "authors", "version", "license", "references"} == set(top) - {
        "abstract",
        "keywords",
    }
    assert all(line.startswith(" ") or re.match(r"[a-z-]+:", line) for line in lines)
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert top["version"].strip() == manifest["version"]
