"""What a row of the comparison is: a method that is fitted to a capture and then renders.

A method of one's own needs no more than an object with these names; `livehand compare --method MODULE:NAME` adds it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol, runtime_checkable

import torch

from ...capture.capture import Capture
from ...evaluation.shot_renderer import ShotRenderer
from ...hand.model import HandModel
from ...training.config import TrainConfig
from ...training.losses import PerceptualDistance
from ...training.processes import ComputeSetup


@dataclass(frozen=True)
class Budget:
    """How much each method may learn: the same number of steps for all, or the same processor time.

    Attributes:
        steps: optimiser steps.
        core_minutes: processor time of all threads instead of a number of steps.
    """

    steps: int = 2000
    core_minutes: float | None = None

    def train_config(self, share: float = 1.0, **settings: Any) -> TrainConfig:
        """Choose the settings of an optimisation with this budget; its clock must be the processor's.

        Args:
            share: of the steps, for methods whose steps see several images.
            settings: other fields of the configuration.
        """
        return TrainConfig(steps=max(1, round(self.steps * share)), minutes=self.core_minutes, **settings)


@dataclass(frozen=True)
class FittingMachine:
    """Where and with what a method is fitted.

    Attributes:
        compute: device and precision.
        perceptual: the perceptual distance; None: no weights are at hand, and its term is left out.
        seed: of weights, order and samples.
        is_inference_only: train nothing where a method can do without.
    """

    compute: ComputeSetup
    perceptual: PerceptualDistance | None = None
    seed: int = 0
    is_inference_only: bool = False

    @property
    def device(self) -> torch.device:
        """The device in use."""
        return self.compute.device


class Fitted(NamedTuple):
    """What a fitted method has cost.

    Attributes:
        steps: optimiser steps; 0 where nothing is optimised.
        core_minutes: processor time, over all sessions.
        parameters: numbers that were learnt.
        remarks: what is to be said below the table of this fit.
    """

    steps: int
    core_minutes: float
    parameters: int
    remarks: str = ""


@runtime_checkable
class Method(Protocol):
    """A row of the comparison.

    Attributes:
        name: of the row, also of its folder: letters, digits, `_` and `-`.
        label: how the tables call it.
        tables: the tables in which it stands.
        version: a number that rises when results would change; a row of another version is fitted again.
        notes: choices that stand below the table.
    """

    @property
    def name(self) -> str: ...  # noqa: D102
    @property
    def label(self) -> str: ...  # noqa: D102
    @property
    def tables(self) -> tuple[str, ...]: ...  # noqa: D102
    @property
    def version(self) -> int: ...  # noqa: D102
    @property
    def notes(self) -> str: ...  # noqa: D102

    def fit(self, capture: Capture, hand: HandModel, budget: Budget, folder: Path, machine: FittingMachine) -> Fitted:
        """Learn the training views; a second call continues what the first one left in the folder."""
        ...

    def load(self, folder: Path, hand: HandModel, device: torch.device) -> ShotRenderer:
        """Load the fitted method."""
        ...
