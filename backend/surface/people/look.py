"""The numbers that an invented person is made of, what they mean, and what they may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from ...capture.person import Person
from ...records.errors import LiveHandError


class NumberSpec(NamedTuple):
    """One number of a person.

    Attributes:
        low, high: limits, both allowed.
        usual: of a young adult.
        meaning: for users.
    """

    low: float
    high: float
    usual: float
    meaning: str


NUMBERS = {
    "age": NumberSpec(18, 90, 30, "years: folds, leather, veins, spots and yellow nails"),
    "tone": NumberSpec(0, 1.2, 0.1, "pigment of the skin, 0 light to 1 deep"),
    "build": NumberSpec(0, 1, 0.75, "shape, 0 slight to 1 broad: women's hands are near 0.25, men's near 0.75"),
    "blood": NumberSpec(0, 2, 1, "how red the skin is; 1 is usual"),
    "veins": NumberSpec(0, 1, 0.25, "height of the veins, mm"),
    "freckles": NumberSpec(0, 3, 0.5, "strength of freckles and spots; 1 is usual"),
    "folds": NumberSpec(0, 2, 1, "depth of folds and creases; 1 is a young adult's"),
    "hair": NumberSpec(0, 3, 1, "hairs on hand and arm, 0 none; 1 is usual"),
    "nails": NumberSpec(0, 2.5, 1, "nails' free edge, mm"),
}
"""By name: the numbers of `PersonLook` beside the seed."""
ADJUSTABLE = ("age", "tone", "blood", "veins", "folds", "hair")
"""Of them, those that can be changed of a person who is there."""
PERSON_NUMBERS = {"tone": "melanin", "blood": "blood", "veins": "veins_mm", "folds": "folds"}
"""The attributes of `Person` that hold them."""
MOST_SEED = 2**31 - 1
_YOUNG, _OLD = 25.0, 80.0
_SHAPE_DEVIATION, _MOST_SHAPE = 0.4, 2.0
# Mean shapes: size, girth, finger length, palm breadth, depth, thumb, little finger, 2D:4D, taper, eminences.
_SLIGHT = np.array([-1.5, -1.2, 0.6, -1.0, -0.6, 0.0, 0.0, 0.5, -0.9, -0.4])
_BROAD = np.array([0.9, 1.0, -0.4, 0.9, 0.5, 0.0, 0.0, -0.3, 0.5, 0.3])
_OLD_SHAPE = np.array([0.0, -0.5, 0.0, 0.0, -0.9, 0.0, 0.0, 0.0, 0.0, -1.2])
_WOMAN, _MAN, _BUILD_DEVIATION = 0.25, 0.75, 0.1


@dataclass(frozen=True)
class PersonLook:
    """An invented person.

    Attributes:
        seed: of everything that no number says: lines, cells, spots, blood, shape.
        age, tone, build, blood, veins, freckles, folds, hair, nails: as in `NUMBERS`.
    """

    seed: int
    age: float
    tone: float
    build: float
    blood: float
    veins: float
    freckles: float
    folds: float
    hair: float
    nails: float

    @classmethod
    def of(cls, seed: int, given: Mapping[str, float | None]) -> PersonLook:
        """Complete what is given: what is not is drawn from the seed, by the age.

        Args:
            seed: of the person.
            given: numbers by the names of `NUMBERS`; None: drawn.

        Raises:
            LiveHandError: one is no number, or beyond its limits.
        """
        if not 0 <= seed <= MOST_SEED:
            raise LiveHandError(f"the seed must be a whole number from 0 to {MOST_SEED}, got {seed!r}")
        numbers = {name: checked_number(name, value) for name, value in given.items() if value is not None}
        return cls(seed, **{**_drawn(seed, numbers), **numbers})

    @property
    def aged(self) -> float:
        """How old the skin is, 0 at 25 years to 1 at 80."""
        return float(np.clip((self.age - _YOUNG) / (_OLD - _YOUNG), 0, 1))

    @property
    def padding(self) -> float:
        """Share of the hollows between the metacarpals that flesh fills: of young women most, of old people none."""
        return float(np.clip(0.75 - 0.45 * (self.build - _WOMAN) - 0.75 * self.aged, 0, 0.75))

    @property
    def tendons(self) -> float:
        """How far the tendons of lifted fingers stand out, as `Person.tendons`."""
        return round(float(np.clip(0.4 + 0.5 * (self.build - _WOMAN) + 0.55 * self.aged, 0.3, 1.2)), 3)

    def random(self, purpose: int) -> np.random.Generator:
        """Return the person's own random numbers for one purpose; others do not change them."""
        return np.random.default_rng([self.seed, purpose])

    def person(self) -> Person:
        """Return the numbers of the person's surface."""
        mean = (1 - self.build) * _SLIGHT + self.build * _BROAD + self.aged * _OLD_SHAPE
        shape = (mean + self.random(0).normal(0, _SHAPE_DEVIATION, 10)).clip(-_MOST_SHAPE, _MOST_SHAPE)
        return Person(
            melanin=self.tone,
            blood=self.blood,
            veins_mm=self.veins,
            folds=self.folds,
            freckles=self.freckles,
            tendons=self.tendons,
            beta=tuple(float(value) for value in shape.round(3)),
        )

    def facts(self) -> dict[str, Any]:
        """Write out the numbers, for the file."""
        return asdict(self)


def numbers_of_age(age: float) -> dict[str, float]:
    """Tell the folds and veins that are usual at an age."""
    aged = max((age - _YOUNG) / (_OLD - _YOUNG), 0)
    return {"folds": 0.9 + 0.7 * aged, "veins": 0.22 + 0.3 * aged}


def checked_number(name: str, value: float) -> float:
    """Return one of `NUMBERS`; raises LiveHandError if it is no number, or beyond its limits."""
    spec = NUMBERS[name]
    if not math.isfinite(value):
        raise LiveHandError(
            f"{name} must be a number from {spec.low:g} to {spec.high:g} ({spec.meaning}), got {value!r}"
        )
    if not spec.low <= value <= spec.high:
        raise LiveHandError(
            f"{name} must be from {spec.low:g} to {spec.high:g} ({spec.meaning}), got {value:g}; give one within"
        )
    return float(value)


def _drawn(seed: int, given: Mapping[str, float]) -> dict[str, float]:
    random = np.random.default_rng([seed, 1])
    age, tone, chance = random.uniform(20, 75), random.choice([0.05, 0.3, 0.6, 1.0]), random.random(6)
    aged = (given.get("age", age) - _YOUNG) / (_OLD - _YOUNG)
    build = float(given.get("build", random.choice([_WOMAN, _MAN]) + random.normal(0, _BUILD_DEVIATION)))
    drawn = {
        "age": age,
        "tone": tone + random.normal(0, 0.04),
        "build": build,
        "blood": 0.8 + 0.4 * chance[0],
        "veins": 0.12 + 0.2 * chance[1] + 0.3 * max(aged, 0),
        "freckles": 1.2 * chance[2] ** 2 + 0.9 * max(aged, 0),
        "folds": 0.8 + 0.2 * chance[3] + 0.7 * max(aged, 0),
        "hair": 2.0 * chance[4] ** 2 * (0.15 + 1.1 * build),
        "nails": 0.5 + 1.0 * chance[5],
    }
    return {name: round(float(np.clip(drawn[name], spec.low, spec.high)), 3) for name, spec in NUMBERS.items()}
