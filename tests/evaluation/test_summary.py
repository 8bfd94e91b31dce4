"""Many views' figures as one line, as a table and as a file."""

import csv
import json
import math
from dataclasses import replace

import pytest
from livehand.backend.evaluation.breakdown import CAUSES, REGIONS
from livehand.backend.evaluation.contrast_bands import CONTRAST_KEYS
from livehand.backend.evaluation.evaluate import ViewScore
from livehand.backend.evaluation.report import (
    by_light,
    by_split,
    gain_db,
    scores_csv,
    summary,
    summary_json,
    summary_tables,
    write_text,
)
from livehand.backend.records.errors import LiveHandError


def score(split="test", angle_deg=10.0, psnr=30.0, shares=(1.0, 0.0, 0.0, 0.0, 0.0), **more):
    figures = {"psnr_full": psnr, "psnr_hand": psnr - 5, "psnr_true_alpha": psnr + 1, **more}
    figures |= dict(zip((f"share_{cause}" for cause in CAUSES), shares, strict=True))
    figures |= {f"area_{region}": 0.25 for region in REGIONS}
    return ViewScore(f"{psnr}.png", split, 3, 7, angle_deg, figures)


def test_metrics_are_averaged_and_shares_are_of_the_total_error():
    found = summary(
        [score(psnr=20.0, angle_deg=4.0), score(psnr=30.0, angle_deg=8.0, shares=(0.0, 0.0, 0.25, 0.25, 0.5))]
    )
    assert found["images"] == 2
    assert (found["psnr_full"], found["psnr_hand"]) == (25.0, 20.0)
    assert (found["camera_gap_deg"], found["camera_gap_max_deg"]) == (6.0, 8.0)
    # The first image has ten times the second's error.
    assert found["share_silhouette"] == pytest.approx(10 / 11, abs=1e-4)
    assert found["share_texture"] == pytest.approx(0.5 / 11, abs=1e-4)


def test_undefined_metrics_do_not_count_and_are_absent_if_all_are_undefined():
    found = summary(
        [
            score(ms_ssim=math.nan, flip=math.nan, angle_deg=math.nan),
            score(ms_ssim=0.5, flip=math.nan, angle_deg=math.nan),
        ]
    )
    assert found["ms_ssim"] == 0.5
    assert not {"flip", "camera_gap_deg", "camera_gap_max_deg"} & found.keys()
    json.dumps(found, allow_nan=False)


def test_every_split_has_its_own_summary():
    found = by_split([score("train", psnr=40.0), score("test"), score("train", psnr=42.0)])
    assert list(found) == ["test", "train"]
    assert (found["train"]["images"], found["train"]["psnr_full"]) == (2, 41.0)


def test_every_kind_of_light_has_a_summary_for_each_split():
    scores = [score(psnr=20.0), score(psnr=24.0), score("novel_light", psnr=30.0)]
    assert by_light(scores) == {}
    lit = [replace(one, light_kind=kind) for one, kind in zip(scores, ("key", "key", "soft"), strict=True)]
    found = by_light(lit)
    assert list(found) == ["novel_light soft", "test key"]
    assert (found["test key"]["images"], found["test key"]["psnr_full"]) == (2, 22.0)
    document = json.loads(summary_json({}, summary(lit), by_split(lit), found))
    assert document["lights"] == found
    assert [row["light_kind"] for row in csv.DictReader(scores_csv(lit).splitlines())] == ["key", "key", "soft"]


def test_contrast_has_a_table_of_its_own_if_it_was_measured():
    plain = summary_tables({"test": summary([score()])})
    contrast = {name: 1.25 for name in CONTRAST_KEYS} | {f"{name}_truth": 2.5 for name in CONTRAST_KEYS}
    *others, table = summary_tables({"test": summary([score(**contrast)])}).split("\n\n")
    assert "\n\n".join(others) == plain
    heading, ours, truth = table.splitlines()
    assert heading.split("  ")[0] == "contrast, L*"
    assert ours.split() == ["test", *["1.25"] * 5]
    assert truth.split() == ["of", "the", "truth", *["2.50"] * 5]


@pytest.mark.parametrize(("share", "gain"), [(0.0, 0.0), (0.5, 3.0103), (0.9, 10.0), (1.0, 99.0)])
def test_the_gain_is_the_psnr_without_the_share(share, gain):
    assert gain_db(share) == pytest.approx(gain, abs=1e-4)


def test_the_csv_has_a_line_for_each_image_and_empty_cells():
    rows = list(
        csv.DictReader(
            scores_csv([score(ssim=math.nan), score("train", angle_deg=math.nan, ssim=0.98765)]).splitlines()
        )
    )
    assert [row["split"] for row in rows] == ["test", "train"]
    assert (rows[0]["file"], rows[0]["camera_index"], rows[0]["pose_index"]) == ("30.0.png", "3", "7")
    assert [row["camera_gap_deg"] for row in rows] == ["10.00", ""]
    assert [row["ssim"] for row in rows] == ["", "0.98765"]
    assert rows[0]["share_silhouette"] == "1.00000"


def test_the_tables_show_metrics_and_the_breakdown():
    lines = summary_tables({"test": summary([score(shares=(0.5, 0.0, 0.0, 0.25, 0.25))])}).splitlines()
    assert lines[0].split() == ["images", "angle", "deg", "PSNR", "dB", "hand"]  # nothing else was measured
    assert lines[1].split() == ["test", "1", "10.0", "30.00", "25.00"]
    assert lines[4].split("  ")[0] == "test"
    assert [cell.strip() for cell in lines[4].split("  ") if cell.strip()] == [
        "test", "50.0 %", "0.0 %", "0.0 %", "25.0 %", "25.0 %",
    ]  # fmt: skip
    assert [cell.strip() for cell in lines[6].split("  ") if cell.strip()] == [
        "PSNR without it", "+3.01 dB", "+0.00 dB", "+0.00 dB", "+1.25 dB", "+1.25 dB", "+1.00 dB",
    ]  # fmt: skip
    widths = {len(line) for line in (lines[4], lines[5])}
    assert len(widths) == 1  # aligned


def test_the_json_holds_all_and_each_split():
    scores = [score(), score("train")]
    document = json.loads(summary_json({"avatar": "a"}, summary(scores), by_split(scores), {}))
    assert document["avatar"] == "a"
    assert document["all"]["images"] == 2
    assert document["splits"]["train"]["images"] == 1


def test_text_is_written_whole_or_refused(tmp_path):
    write_text("new\n", tmp_path / "deep" / "file.txt")
    assert (tmp_path / "deep" / "file.txt").read_text() == "new\n"
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["file.txt"]
    with pytest.raises(LiveHandError, match="must be writable"):
        write_text("", tmp_path / "deep" / "file.txt" / "below.txt")
