"""Tables of results, by value: small documents in, lines of Markdown out."""

import pytest
from livehand.tools.results import tables

SOURCE = {"what": "`livehand x`", "date": "2026-11-28", "commit": "abc1234"}
ORIGIN = ["", "*`livehand x` (2026-11-28, commit abc1234).*"]


def spread(median, p10, p90):
    return {"median": median, "p10": p10, "p90": p90}


BENCHMARK = {
    "source": SOURCE,
    "result": {
        "machine": {
            "cpu": "A Processor",
            "cores": 2,
            "threads": 2,
            "python": "3.11.1",
            "torch": "2.13",
            "numba": True,
            "avx512_vnni": True,
            "avx512_bf16": False,
            "amx": True,
            "load_before": 3.5,
            "busy": True,
            "peaks": {"fp32_tflops": 0.5, "bf16_tflops": 0.94, "int8_tflops": 2.0, "gb_per_s": 78.0},
        },
        "sizes": {
            "334x512": {
                "coverage": 0.2951,
                "frames": {"default_bf16": 16, "published": 2, "cycles_64": 3},
                "frame_ms": {
                    "cycles_64": spread(14742.4, 14101.0, 17716.0),
                    "default_bf16": spread(65.74, 61.3, 76.2),
                    "published": spread(903.4, 866.0, 1246.0),
                },
                "core_s": {
                    "cycles_64": spread(29.271, 29.0, 30.0),
                    "default_bf16": spread(0.1004, 0.09, 0.11),
                    "published": spread(1.614, 1.6, 1.7),
                },
                "stages": {
                    "default_bf16": {"pose": {"ms": 4.02, "core_s": 0.0041}, "light": {"ms": 18.5, "core_s": 0.027}},
                    "published": {"pose": {"ms": 2.7, "core_s": 0.004}, "decode": {"ms": 3.6, "core_s": 0.004}},
                },
                "floor_ms": {"default_bf16": {"pose": 0.044}},
                "over_floor": {"default_bf16": {"pose": 90.2}},
                "ratio_paper": {"bf16": 14.24},
                "ratio_paper_bf16": 5.5,
                "ratio_paper_fp32": None,
                "ratio_cycles": {"16": {}, "64": {"bf16": 240.1, "fp32": 214.4}},
                "peak_mb": {"default_bf16": 206.4, "published": None},
            }
        },
    },
}


def avatar(shift=0.0):
    """An avatar with one view in the first split and three in each of the others."""
    metrics = {
        split: {"images": 1 if split == "novel_light" else 3, "psnr_hand": 34.0 + shift, "flip": 0.03}
        | {f"{band}": 0.9 for band in tables.BANDS}
        | {f"{band}_truth": 1.0 for band in tables.BANDS}
        for split in tables.SPLITS
    }
    metrics["novel_light"]["psnr_hand"] = 44.0 + shift
    metrics["novel_light"]["l_1_2"] = 1.9
    person = {"melanin": 0.42, "blood": 1.0, "freckles": 0.3, "veins_mm": 0.15, "folds": 1.0, "beta": [0.2, -1.1]}
    return {"person": person, "trainings": 5, "bytes": 7925350, "licence": "GPL-3.0-or-later", "metrics": metrics}


AVATARS = {"source": SOURCE, "people": {"light": avatar(), "deep": avatar(-2.0)}}
AGAINST_CYCLES = {
    "tables": {
        "psnr": {
            "source": SOURCE,
            "columns": ["hand, dB", "whole", "close-up"],
            "rows": [
                ["soft", "36.0 (2)", "34.8 (2)"],
                ["key", "34.1 (2)", "-"],
                ["rim", "34.4 (4)", "-"],
                ["block", "33.5 (2)", "-"],
            ],
        }
    }
}


@pytest.mark.parametrize(
    ("value", "text"), [(0.044, "0.04"), (4.02, "4.0"), (99.94, "99.9"), (206.4, "206"), (14742.4, "14,742")]
)
def test_numbers_have_the_digits_that_a_reader_can_use(value, text):
    assert tables.digits(value) == text


def test_a_recorded_table_is_shown_as_it_was_kept_with_its_origin():
    assert tables.recorded(AGAINST_CYCLES, "psnr")[:3] == [
        "| hand, dB | whole | close-up |",
        "| --- | ---: | ---: |",
        "| soft | 36.0 (2) | 34.8 (2) |",
    ]
    assert tables.recorded(AGAINST_CYCLES, "psnr")[-2:] == ORIGIN


def test_the_machine_tells_its_load_and_that_it_was_busy():
    lines = tables.machine(BENCHMARK)
    assert lines[2] == "| processor | A Processor, 2 cores, 2 threads used |"
    assert lines[3] == "| instructions | avx512_vnni, amx |"
    assert lines[4] == "| software | python 3.11.1, torch 2.13, numba |"
    assert lines[7] == "| programs that wanted a core in the minute before | 3.5, busy |"


def test_frames_stand_in_the_order_of_the_configurations():
    assert tables.frames(BENCHMARK)[2:] == [
        "| 334x512 (29.5 %) | `default_bf16` | 65.7 | 61.3 to 76.2 | 100 | 206 | 16 |",
        "| 334x512 (29.5 %) | `published` | 903 | 866 to 1,246 | 1,614 | | 2 |",
        "| 334x512 (29.5 %) | `cycles_64` | 14,742 | 14,101 to 17,716 | 29,271 | | 3 |",
    ]


def test_ratios_leave_out_what_was_not_measured():
    assert tables.ratios(BENCHMARK)[2:] == [
        "| the paper's renderer as published | 14.2 times | |",
        "| Cycles, 64 samples | 240 times | 214 times |",
        "| the paper's networks in our renderer, same precision | 5.5 times | |",
    ]


def test_stages_of_both_renderers_with_the_floor_where_there_is_one():
    assert tables.stages(BENCHMARK)[2:] == [
        "| `pose` | 4.0 | 4.1 | 0.04 | 90.2 | | | | 2.7 |",
        "| `light` | 18.5 | 27.0 | | | | | | |",
        "| `decode` | | | | | | | | 3.6 |",
    ]


def test_people_are_numbers_of_their_headers():
    lines = tables.people(AVATARS)
    assert lines[0] == "| | light | deep |"
    assert "| shape, greatest of beta | -1.1 | -1.1 |" in lines
    assert "| views in the header | 10 | 10 |" in lines
    assert "| file, MB | 7.9 | 7.9 |" in lines


def test_means_of_splits_count_every_view_once():
    # (44 + 9 * 34) / 10 = 35
    assert tables.splits(AVATARS)[2] == "| light | 44.0 (1) | 42.0 (1) | 0.030 | 0.030 |"
    assert tables.splits(AVATARS)[-1] == "| **all views** | 35.0 | 33.0 | 0.030 | 0.030 |"


def test_contrast_is_a_share_of_the_truths():
    # (1.9 + 9 * 0.9) / 10 = 1.0 of 1.0; the other bands 0.9 of 1.0
    assert tables.contrast(AVATARS)[2:4] == ["| 1 to 2 mm | 100 % | 100 % |", "| 2 to 4 mm | 90 % | 90 % |"]


def test_headers_without_contrast_are_left_out():
    bare = avatar()
    del bare["metrics"]["test"]["l_1_2"]
    assert tables.contrast({"people": {"light": avatar(), "deep": bare}})[0] == "| band | light |"


def test_the_worse_side_of_a_rig_counts():
    cases = [
        {"rig": "A", "bones": 17.0, "joints_deg": 0.01, "wrist_mm": 0.5},
        {"rig": "A", "bones": 17.0, "joints_deg": 0.02, "wrist_mm": 0.25},
        {"rig": "B", "bones": 21.0, "joints_deg": 0.0, "wrist_mm": 0.0},
    ]
    assert tables.round_trips({"rigs": cases, "source": SOURCE})[2:4] == [
        "| A | 2 | 17 | 0.0200 | 0.5000 |",
        "| B | 1 | 21 | 0.0000 | 0.0000 |",
    ]


IDLE = {
    "tables": {
        "frames": {
            "source": SOURCE,
            "columns": ["idle cores", "bf16, ms", "bf16, core-ms", "faster than the paper's renderer, bf16"],
            "rows": [["1920x1080", "326", "", ""], ["334x512", "104", "167", "15.7 times"]],
        }
    }
}


def test_the_readmes_rows_are_of_the_light_avatar_and_of_an_idle_machine():
    assert tables.summary(AGAINST_CYCLES, AVATARS, BENCHMARK, IDLE)[2:] == [
        "| [PSNR](docs/results/quality.md#by-light) on whole hands of all nine people, by light "
        "| 36.0 dB soft, 34.1 key, 34.4 rim, 33.5 beside walls |",
        "| [contrast](docs/results/quality.md#contrast) of the skin at 1 to 16 mm | 90 to 100 % of the truth's |",
        "| [a frame](docs/results/speed.md#the-run) of 334x512 on the CPU | 104 ms, 167 of processor time |",
        "| [faster](docs/results/speed.md#frames) than others | 15.7 times the paper's renderer |",
    ]


def test_a_benchmark_that_was_not_disturbed_is_told_itself():
    assert tables.measured_speed(BENCHMARK["result"]["sizes"]["334x512"]) == (
        "65.7 ms, 100 of processor time",
        "14.2 times the paper's renderer, 240 times Cycles",
    )
