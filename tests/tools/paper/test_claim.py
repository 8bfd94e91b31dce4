"""The experiment on the paper's central claim: what is counted, and what is gathered."""

import json

import numpy as np
import pytest
from livehand.backend.research.comparison.grid import save_pictures
from livehand.tools.paper import claim
from livehand.tools.paper.claim import (
    FULL,
    NONE,
    PATCH,
    SEEDS,
    SHARP_FULL,
    SHARP_NONE,
    gathered,
    sign_test,
    two_sided,
)

ROWS = ("planes_none", "planes_full")


@pytest.mark.parametrize(("lower", "count", "p"), [(5, 10, 1.0), (10, 10, 2 / 1024), (0, 3, 0.25), (8, 9, 20 / 512)])
def test_a_fair_coin_falls_as_unevenly_that_often(lower, count, p):
    assert two_sided(lower, count) == pytest.approx(p)


def test_views_are_counted_by_the_mean_over_seeds():
    plain = {("plain", seed): {"a": {"lpips": 0.2}, "b": {"lpips": 0.2}, "c": {"lpips": 0.2}} for seed in SEEDS}
    lpips = {0: (0.1, 0.25, 0.3), 1: (0.1, 0.1, 0.3), 2: (0.1, 0.12, 0.1)}
    ours = {("ours", seed): {f: {"lpips": v} for f, v in zip("abc", lpips[seed], strict=True)} for seed in SEEDS}
    found = sign_test({**plain, **ours}, "ours", "plain")
    assert (found["views"], found["lower_views"], found["pairs"], found["lower_pairs"]) == (3, 2, 9, 6)
    assert found["p"] == 1.0
    assert found["mean_gap"] == pytest.approx(-0.0367, abs=1e-4)


def test_figures_and_pictures_of_all_seeds_are_gathered(tmp_path, monkeypatch):
    for row, shift in zip(ROWS, (0.0, -0.01), strict=True):
        for seed in SEEDS:
            folder = tmp_path / f"seed{seed}" / "rows" / row
            folder.mkdir(parents=True)
            lines = [f"{k}.png,{28 + seed},0.9,{0.05 + shift}" for k in range(6)]
            (folder / "scores.csv").write_text("\n".join(["file,psnr_hand,ssim,lpips", *lines]) + "\n")
            summary = {"": {split: {"vgg19_frechet": 10.0 + seed} for split in ("test", "novel_pose")}}
            (folder / "summary.json").write_text(json.dumps(summary))
            save_pictures([(np.zeros((4, 4, 4)), np.ones((4, 4, 4)))], folder / "pictures.npz")
    found = gathered(tmp_path, ROWS, 500)
    assert found["tables"]["rows"]["rows"] == [
        ["`planes_none`", "28.0 to 30.0", "0.9000 to 0.9000", "0.0500 to 0.0500", "10.0 to 12.0"],
        ["`planes_full`", "28.0 to 30.0", "0.9000 to 0.9000", "0.0400 to 0.0400", "10.0 to 12.0"],
    ]
    assert found["tests"] == {
        "planes_full": {"views": 6, "lower_views": 6, "p": 2 / 64, "pairs": 18, "lower_pairs": 18, "mean_gap": -0.01}
    }
    picture = np.asarray(claim._grid(tmp_path, ROWS))
    assert picture.shape == (3 * 144, 144, 3)
    assert [picture[row].mean() for row in (0, 200, 400)] == [0, 255, 255]


def test_the_rows_differ_in_the_perceptual_loss_alone():
    assert NONE.config == FULL.config == PATCH.config
    assert SHARP_NONE.config == SHARP_FULL.config
    assert (NONE.loss.perceptual, FULL.loss.perceptual, SHARP_NONE.loss.perceptual) == (0, 1, 0)
    assert {row.loss.perceptual_region for row in (FULL, SHARP_FULL)} == {"crop"}
    assert (PATCH.loss.perceptual_region, PATCH.loss.perceptual_patch_px) == ("patch", 32)
    assert {row.name for row in (NONE, FULL, PATCH, SHARP_NONE, SHARP_FULL)} == claim.ROWS.keys()
