"""Claims measured again: a drift is found and fails, a time of another or a busy machine is not compared but told."""

from copy import deepcopy

import pytest
from livehand.tools.results import claims
from livehand.tools.results.claims import Outcome, benchmark, by_hand, idle, main, options_of, release
from livehand.tools.results.write import DATA, ROOT, read_documents

MACHINE = {"cpu": "A Processor", "threads": 2, "avx512_vnni": True, "busy": False}
SIZE = {
    "coverage": 0.3,
    "frame_ms": {"default_bf16": {"median": 100.0}, "default_fp32": {"median": 130.0}},
    "core_s": {"default_bf16": {"median": 0.15}, "default_fp32": {"median": 0.2}},
    "stages": {"default_bf16": {"pose": {"ms": 1.0}, "light": {"ms": 60.0}}},
    "ratio_paper": {"bf16": 16.0, "fp32": 12.0},
    "ratio_cycles": {},
    "peak_mb": {"default_bf16": 68.0, "published": None},
}
RESULT = {"machine": MACHINE, "sizes": {"334x512": SIZE}}
WHAT = {"what": "`livehand benchmark --no-cycles --frames 12`, a machine"}
COLUMNS = ["idle cores", "bf16, ms", "fp32, ms", "bf16, core-ms", "fp32, core-ms", "faster, bf16", "fp32"]
DOCUMENTS = {
    "benchmark": {"source": WHAT, "result": RESULT},
    "idle": {
        "tables": {
            "frames": {
                "source": WHAT,
                "columns": COLUMNS,
                "rows": [["334x512", "100", "130", "150", "200", "16.0 times", "12.0 times"]],
            }
        }
    },
    "release": {"zips": {"slim": 15.0, "linux_x64-py311": 290.0}},
}


@pytest.fixture
def found(monkeypatch):
    """What the benchmark finds now; a test changes it."""
    result = deepcopy(RESULT)
    monkeypatch.setattr(claims, "collect_benchmark", lambda options: {"result": result})
    return result


def change(result, *keys, value):
    for key in keys[:-1]:
        result = result[key]
    result[keys[-1]] = value


@pytest.mark.parametrize(
    ("shown", "now", "drifts"),
    [
        (100.0, 105.0, 0),
        (100.0, 94.9, 1),
        (100, 106, 1),
        ("light", "deep", 1),
        ({"a": 1}, {}, 1),
        ({"a": 1}, {"a": 1, "b": 2}, 1),
        ([1.0, 2.0], [1.0, 2.2], 1),
        ([1.0], [1.0, 1.0], 1),
        (True, 1.04, 1),
        (None, None, 0),
    ],
)
def test_numbers_may_differ_by_a_twentieth_and_all_else_not_at_all(shown, now, drifts):
    outcome = Outcome()
    outcome.compare("it", shown, now)
    assert len(outcome.drifts) == drifts


@pytest.mark.parametrize("part", [benchmark, idle])
def test_the_same_figures_hold(found, part):
    outcome = part(DOCUMENTS)
    assert outcome.compared >= 6
    assert outcome.drifts == outcome.unmeasured == []


@pytest.mark.parametrize(
    ("keys", "value", "names"),
    [
        (("frame_ms", "default_bf16", "median"), 106.0, {benchmark: "default_bf16 frame_ms", idle: "bf16, ms"}),
        (("core_s", "default_fp32", "median"), 0.22, {benchmark: "default_fp32 core_s", idle: "fp32, core-ms"}),
        (("ratio_paper", "bf16"), 14.0, {benchmark: "ratio_paper bf16", idle: "faster, bf16"}),
        (("stages", "default_bf16", "light", "ms"), 66.0, {benchmark: "default_bf16 stage light"}),
        (("peak_mb", "default_bf16"), 80.0, {benchmark: "peak_mb default_bf16"}),
    ],
)
def test_a_drift_is_found_by_name(found, keys, value, names):
    change(found, "sizes", "334x512", *keys, value=value)
    for part, name in names.items():
        (drift,) = part(DOCUMENTS).drifts
        assert name in drift


def test_a_tiny_stage_may_double_as_it_is_a_share_of_the_frame(found):
    change(found, "sizes", "334x512", "stages", "default_bf16", "pose", "ms", value=2.0)
    assert benchmark(DOCUMENTS).drifts == []


def test_a_busy_machine_compares_ratios_and_processor_time_alone(found):
    found["machine"]["busy"] = True
    change(found, "sizes", "334x512", "frame_ms", "default_bf16", "median", value=900.0)
    outcome = benchmark(DOCUMENTS)
    assert outcome.drifts == []
    assert outcome.unmeasured == ["benchmark's milliseconds: the machine is busy now, or was when they were measured"]
    found["machine"]["busy"] = False
    then = deepcopy(DOCUMENTS)
    then["benchmark"]["result"]["machine"]["busy"] = True
    assert len(benchmark(then).unmeasured) == 1
    found["machine"]["busy"] = True
    change(found, "sizes", "334x512", "ratio_paper", "bf16", value=10.0)
    assert len(benchmark(DOCUMENTS).drifts) == 1
    assert idle(DOCUMENTS).unmeasured == ["idle.frames: the machine is busy"]


def test_another_machine_is_not_compared(found):
    found["machine"]["cpu"] = "Another"
    outcome = benchmark(DOCUMENTS)
    assert outcome.compared == 0
    assert outcome.unmeasured == ["benchmark: measured on another machine (cpu A Processor, here Another)"]


def test_zips_are_compared_if_they_are_built(monkeypatch):
    monkeypatch.setattr(claims, "collect_release", lambda: {"zips": {"linux_x64-py311": 310.0}})
    outcome = release(DOCUMENTS)
    assert outcome.drifts == ["zip linux_x64-py311: 290.0 is shown, 310.0 was found"]
    assert outcome.unmeasured == ["zip slim: not in dist/release; make release"]


@pytest.mark.nightly
def test_the_avatars_headers_hold_and_the_exit_code_tells(monkeypatch, capsys):
    """The real ones, which take a second."""
    assert main(["avatars"]) == 0
    last = capsys.readouterr().out.splitlines()[-1]
    assert int(last.split()[0]) > 100
    assert last.endswith("0 drifted by more than 5 %")
    real = claims.collect_avatars()
    change(real, "people", "light", "metrics", "test", "psnr_hand", value=30.0)
    monkeypatch.setattr(claims, "collect_avatars", lambda: real)
    assert main(["avatars"]) == 1
    assert "drifted: avatar light metrics test psnr_hand: 3" in capsys.readouterr().out


def test_what_cannot_be_measured_fails_only_where_all_must_be(monkeypatch, capsys):
    monkeypatch.setattr(claims, "collect_release", lambda: {"zips": {}})
    assert main(["release"]) == 0
    assert "not measured: zip slim" in capsys.readouterr().out
    assert main(["release", "--strict"]) == 1


def test_what_rigs_lose_counts_as_a_share_of_what_they_may_lose(monkeypatch):
    rig = {
        "rig": "A",
        "side": "left",
        "bones": 17.0,
        "joints_deg": 0.001,
        "forearm_deg": 0.0,
        "wrist_mm": 0.1,
        "keys": 6.0,
    }
    found = [rig | {"joints_deg": 0.003, "wrist_mm": 0.2}]
    monkeypatch.setattr(claims, "collect_round_trips", lambda: {"rigs": found})
    outcome = claims.round_trips({"round_trips": {"rigs": [rig]}})
    assert outcome.compared == 4
    (drift,) = outcome.drifts
    assert drift == "A left wrist_mm: 0.1 is shown, 0.2 was found"


def test_every_table_is_measured_again_or_listed_with_what_made_it():
    listed = list(by_hand(read_documents(ROOT / DATA)))
    assert any(line.startswith("against_cycles.psnr: `python -m livehand.tools") for line in listed)
    assert not any(line.startswith(("idle.", "zips", "summary", "people")) for line in listed)


def test_the_options_are_those_of_the_source():
    assert options_of("`livehand benchmark --a 1 --b`, a machine") == ["--a", "1", "--b"]
    with pytest.raises(ValueError, match="must name `livehand benchmark"):
        options_of("`livehand compare`")
    documents = read_documents(ROOT / DATA)
    for what in (documents["benchmark"]["source"]["what"], documents["idle"]["tables"]["frames"]["source"]["what"]):
        assert "--frames" in options_of(what)
