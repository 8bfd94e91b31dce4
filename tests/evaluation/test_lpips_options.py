"""Which LPIPS is measured: what is asked for, else AlexNet's if it is there; and its absence is told."""

import argparse
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch
from livehand.backend.evaluation import distances, lpips_options
from livehand.backend.evaluation.lpips_options import add_lpips_arguments, lpips_names, lpips_note, lpips_of
from livehand.backend.records.errors import LiveHandError

CPU = torch.device("cpu")


class Network(torch.nn.Module):
    def __init__(self, column):
        super().__init__()
        self.column, self.backbone = column, SimpleNamespace(min_side_px=1)


@pytest.fixture
def parsed():
    parser = argparse.ArgumentParser()
    add_lpips_arguments(parser)
    return lambda text: parser.parse_args(text.split())


@pytest.fixture
def fetched_networks(monkeypatch):
    monkeypatch.setattr(lpips_options, "has_lpips", lambda name: True)
    monkeypatch.setattr(
        distances, "fetched_lpips", lambda name, mode: Network({"alexnet": "lpips", "vgg16": "lpips_vgg16"}[name])
    )
    monkeypatch.setattr(distances, "load_lpips", lambda *files: Network("uncalibrated"))


@pytest.fixture
def nothing_fetched(monkeypatch, tmp_path):
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))


ALEX, VGG = ["lpips", "lpips_reference"], ["lpips_vgg16", "lpips_vgg16_reference"]


@pytest.mark.parametrize(
    ("text", "columns", "names"),
    [
        ("", ALEX, ["LPIPS 0.1 alexnet"]),
        ("--lpips vgg16", VGG, ["LPIPS 0.1 vgg16"]),
        ("--lpips alexnet vgg16 alexnet", ALEX + VGG, ["LPIPS 0.1 alexnet", "LPIPS 0.1 vgg16"]),
        ("--lpips none", [], []),
        (
            "--lpips-weights a/net.pth b/heads.pth",
            ["uncalibrated", "uncalibrated_reference"],
            ["net.pth", "heads.pth"],
        ),
    ],
)
def test_each_network_has_a_column_of_its_own(parsed, fetched_networks, text, columns, names):
    args = parsed(text)
    assert [distance.name for distance in lpips_of(args, CPU)] == columns
    assert lpips_names(args) == names
    assert lpips_note(args) is None


def test_without_the_weights_nothing_else_takes_the_name(parsed, nothing_fetched):
    args = parsed("")
    assert lpips_of(args, CPU) == []
    assert lpips_names(args) == []
    assert lpips_note(args).endswith("fetch them once: livehand fetch-perceptual")
    assert lpips_note(parsed("--lpips none")) is None


def test_what_was_asked_for_and_is_missing_is_an_error(parsed, nothing_fetched):
    with pytest.raises(LiveHandError, match="livehand fetch-perceptual"):
        lpips_of(parsed("--lpips vgg16"), CPU)
    with pytest.raises(LiveHandError, match="no perceptual weights at"):
        lpips_of(argparse.Namespace(lpips=None, lpips_weights=(Path("no"), Path("none"))), CPU)


def test_both_sources_at_once_are_wrong_usage(parsed, capsys):
    with pytest.raises(SystemExit):
        parsed("--lpips vgg16 --lpips-weights a b")
