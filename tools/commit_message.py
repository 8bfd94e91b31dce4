"""Check a commit's message for the hook `commit-msg`: `python tools/commit_message.py FILE`.

The subject says where and what, as an order: `scope: imperative`, in at most 72 characters, so that `git log --oneline`
can be read. Why belongs into the body, after an empty line. Merges, reverts and fixups keep what git writes.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

LONGEST = 72
SUBJECT = re.compile(r"(?P<scope>[a-z0-9][a-z0-9_./, -]*): (?P<verb>\S+)(?P<rest>.*)")
GITS_OWN = ("Merge ", "Revert ", "fixup! ", "squash! ", "amend! ")
# Words that end as a participle does and are none.
VERBS_IN_ED_OR_ING = {"bleed", "bring", "embed", "exceed", "feed", "need", "ping", "proceed", "seed", "speed", "string"}
NOT_IMPERATIVE = re.compile(r"[a-z]+(ed|ing)|(add|fix|make|use|remove|move|keep|write|read|let)s|fixes|the|a|an")


def main(arguments: list[str]) -> int:
    """Check the message in the file that git names; return the exit code."""
    faults = find_faults(Path(arguments[0]).read_text(encoding="utf-8"))
    sys.stderr.write("".join(f"commit message: {fault}\n" for fault in faults))
    return 1 if faults else 0


def find_faults(message: str) -> list[str]:
    """Return a sentence for every rule that a message breaks."""
    lines = [line.rstrip() for line in message.splitlines() if not line.startswith("#")]
    subject = lines[0] if lines else ""
    if subject.startswith(GITS_OWN):
        return []
    faults = []
    if len(subject) > LONGEST:
        faults.append(f"the subject must have at most {LONGEST} characters, got {len(subject)}; say why in the body")
    match = SUBJECT.fullmatch(subject)
    if match is None:
        faults.append(f"the subject must be `scope: imperative`, as in `light: read lamps once`, got {subject!r}")
    elif not is_imperative(match["verb"]):
        faults.append(f"the subject must go on with a verb as in an order, such as `add`, got {match['verb']!r}")
    if subject.endswith("."):
        faults.append("the subject must have no full stop; remove it")
    if len(lines) > 1 and lines[1]:
        faults.append("the line after the subject must be empty; begin the body after it")
    return faults


def is_imperative(verb: str) -> bool:
    """Tell whether a word may be a verb as in an order: no participle, no third person, no article."""
    return verb.lower() in VERBS_IN_ED_OR_ING or not NOT_IMPERATIVE.fullmatch(verb.lower())


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
