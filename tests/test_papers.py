"""README cites the papers, and CITATION.cff has the version of the manifest."""

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parent.parent


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
