"""Rows of the one trainer: each differs from the paper's in what its name says, trains, and goes on."""

from dataclasses import replace

import pytest
from livehand.backend.evaluation.shot_renderer import ShotRenderer
from livehand.backend.field.field import FieldConfig
from livehand.backend.image.superres import SuperResConfig
from livehand.backend.records.errors import LiveHandError
from livehand.backend.research.baselines.avatar_rows import AVATAR_ROWS, REFINED
from livehand.backend.research.baselines.method import Method

ROWS = {row.name: row for row in (*AVATAR_ROWS, REFINED)}


def test_every_row_is_a_method_with_a_name_of_its_own():
    assert len(ROWS) == len(AVATAR_ROWS) + 1
    assert all(isinstance(row, Method) for row in ROWS.values())


def test_an_ablation_changes_one_thing():
    paper = ROWS["paper"]
    assert paper.config.sampler.samples_per_ray == 8
    assert (paper.loss.perceptual_share, paper.loss.perceptual_rise) == (1.0, 0.0)
    for name in ("no_pose", "xyz", "bones"):
        row = ROWS[name]
        assert row.loss == paper.loss
        assert replace(row.config, field=paper.config.field) == paper.config
    for name in ("bilinear", "no_sr", "no_sr_full", "no_sr_patch"):
        assert replace(ROWS[name].config, superres=paper.config.superres) == paper.config
    assert ROWS["bilinear"].loss == paper.loss
    assert ROWS["no_sr"].loss.perceptual == 0
    assert ROWS["no_sr_patch"].loss.perceptual_region == "patch_all"
    assert {row.config.sampler.samples_per_ray for row in ROWS.values()} == {8}
    assert paper.with_samples(16).config.sampler == replace(paper.config.sampler, samples_per_ray=16)


@pytest.mark.parametrize("name", ["no_sr", "bones"])
def test_a_row_trains_and_renders(name, painted_capture, hand, machine, two_steps, cpu, tmp_path):
    row = replace(ROWS[name], loss=replace(ROWS[name].loss, perceptual=0.0))
    fitted = row.fit(painted_capture, hand, two_steps, tmp_path, machine)
    assert fitted.steps == 2
    assert fitted.core_minutes > 0
    again = row.fit(painted_capture, hand, two_steps, tmp_path, machine)
    assert (again.steps, again.core_minutes) == (2, fitted.core_minutes)
    assert isinstance(row.load(tmp_path, hand, cpu), ShotRenderer)


def test_a_row_about_the_perceptual_loss_needs_its_weights(painted_capture, hand, machine, two_steps, tmp_path):
    with pytest.raises(LiveHandError, match="--perceptual-weights"):
        ROWS["no_sr_full"].fit(painted_capture, hand, two_steps, tmp_path, machine)
    assert FieldConfig("xyz").kind == ROWS["xyz"].config.field.kind
    assert SuperResConfig(kind="none") == ROWS["no_sr_full"].config.superres
