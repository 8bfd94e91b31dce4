"""Several shots, one after the other: one that fails does not stop the others."""

from __future__ import annotations

from collections.abc import Sequence

from ...backend.batch.progress import Failed
from ...backend.batch.report import RunReport
from ...backend.records.errors import LiveHandError
from .plan import SequencePlan
from .sequence import write_sequence


def write_batch(plans: Sequence[SequencePlan], report: RunReport) -> None:
    """Render shots; what fails is told to the report, at once."""
    for plan in plans:
        tell = report.of(plan.shot)
        try:
            write_sequence(plan, tell)
        except LiveHandError as error:
            tell(Failed(str(error)))
