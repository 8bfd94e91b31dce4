"""Options that are derived from configuration dataclasses."""

import argparse
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Literal

import pytest
from livehand.backend.system.options import add_options, field_docstrings, from_options, number_parser

Minutes = Annotated[float, number_parser("a number of minutes", lambda value: 0 <= value < inf)]


@dataclass(frozen=True)
class Config:
    step_count: int = 10
    """Number of steps, of which
    100 % count."""
    minutes: Minutes | None = None
    """Time instead of steps."""
    region: Annotated[Literal["crop", "patch"], lambda text: text.replace("window", "crop")] = "crop"
    """RGB region."""
    folder: Path | None = None
    """Where files are written."""
    rate: float = 0.5
    """Not an option."""


def parser():
    made = argparse.ArgumentParser("test")
    group = made.add_mutually_exclusive_group()
    add_options(group, Config, "step_count", "minutes")
    add_options(made, Config, "region", "folder")
    made.add_argument("--other")
    return made


def parsed(*arguments):
    return from_options(Config, parser().parse_args(arguments))


def test_without_arguments_every_default_stays():
    assert parsed() == Config()


def test_text_is_converted_to_the_type_of_the_field():
    assert parsed("--minutes", "2", "--folder", "a/b", "--region", "patch") == Config(
        minutes=2.0, folder=Path("a/b"), region="patch"
    )
    assert parsed("--step-count", "3", "--other", "x") == Config(step_count=3)
    assert parsed("--region", "window").region == "crop"


def test_explicit_values_come_first():
    args = parser().parse_args(["--step-count", "3"])
    assert from_options(Config, args, step_count=4, rate=0.1) == Config(step_count=4, rate=0.1)


def test_the_help_is_the_docstring_and_the_default():
    text = " ".join(parser().format_help().split())
    assert "number of steps, of which 100 % count (default: 10)" in text
    assert "--minutes MINUTES time instead of steps --" in text
    assert "--region {crop,patch} RGB region (default: crop)" in text
    assert field_docstrings(Config)["rate"] == "Not an option."


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--step-count", "two"], "invalid int value: 'two'"),
        (["--minutes", "-1"], "must be a number of minutes, got '-1'"),
        (["--minutes", "soon"], "must be a number of minutes, got 'soon'"),
        (["--minutes", "nan"], "must be a number of minutes, got 'nan'"),
        (["--region", "all"], "invalid choice: 'all'"),
        (["--minutes", "1", "--step-count", "1"], "not allowed with argument"),
    ],
)
def test_bad_values_are_refused(capsys, arguments, message):
    with pytest.raises(SystemExit):
        parsed(*arguments)
    assert message in capsys.readouterr().err
