"""`livehand compare`: a killed one ends as an unbroken one, other settings are refused, and one's own row appears."""

import json
import shutil
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from livehand.backend.capture.capture import save_capture_index
from livehand.backend.capture.lights import CaptureLight
from livehand.backend.records.errors import LiveHandError
from livehand.backend.records.light import Light
from livehand.backend.research.baselines.avatar_rows import FROM_THE_START, AvatarRow
from livehand.backend.research.baselines.mesh_wrapping import MESH_TEXTURE, MESH_WRAPPING
from livehand.backend.research.baselines.method import Budget, Fitted, FittingMachine
from livehand.backend.research.comparison import run as run_module
from livehand.backend.research.comparison.grid import detailed_part, load_pictures, save_pictures
from livehand.backend.research.comparison.measures import Measures
from livehand.backend.research.comparison.misfit import Misfit
from livehand.backend.research.comparison.page import Line, Page, Table
from livehand.backend.research.comparison.rows import METHODS, AvatarSettings, Row, chosen_rows, load_own_method
from livehand.backend.research.comparison.run import Comparison, ComparisonPlan
from livehand.backend.research.comparison.speed import SpeedPlan
from livehand.backend.system.command import run_commands
from livehand.backend.training.config import PAPER
from livehand.backend.training.processes import ComputeSetup
from livehand.livehand_blender.cli import COMMANDS
from PIL import Image

HERE = str(Path(__file__).parent)
WRAPPING, TEXTURE = replace(MESH_WRAPPING, resolution=64), replace(MESH_TEXTURE, resolution=64)


@pytest.fixture
def own(monkeypatch):
    monkeypatch.syspath_prepend(HERE)
    yield load_own_method("own_method:ROW")
    sys.modules.pop("own_method", None)


@pytest.fixture(scope="module")
def capture(painted_capture):
    """The painted capture; its held-out camera counts as a held-out pose too."""
    views = list(painted_capture.views)
    views[3] = replace(views[3], split="novel_pose")
    return replace(painted_capture, views=tuple(views))


@pytest.fixture
def compared(capture, hand, tmp_path):
    """A function (folder, rows, **plan) -> the comparison."""

    def compare(folder, methods, **changes):
        rows = tuple(Row(method, method.tables) for method in methods)
        wanted = tuple(row.name for row in rows)
        plan = ComparisonPlan(rows, wanted, Budget(steps=2), speed=None, max_images=2)
        machine = FittingMachine(ComputeSetup(torch.device("cpu")))
        return Comparison(replace(plan, **changes), capture, hand, tmp_path / folder, machine, Measures())

    return compare


def figures_of(folder):
    """The tables without what depends on the clock."""
    document = json.loads((folder / "tables.json").read_text())
    for table in document["tables"]:
        for row in table["rows"]:
            del row["core_minutes"]
    return document


class KilledComparison(BaseException):
    pass


def test_a_killed_comparison_ends_as_an_unbroken_one(compared, own, tmp_path, monkeypatch):
    methods = (WRAPPING, TEXTURE, own)
    compared("whole", methods).run()
    fits = []
    fit = type(WRAPPING).fit

    def fit_or_die(self, *arguments):
        fits.append(self.name)
        if fits.count("mesh_texture") == 1 and self.name == "mesh_texture":
            raise KilledComparison
        return fit(self, *arguments)

    monkeypatch.setattr(type(WRAPPING), "fit", fit_or_die)
    with pytest.raises(KilledComparison):
        compared("killed", methods).run()
    partial = figures_of(tmp_path / "killed")  # the cheapest, the user's own, came first
    assert [row["name"] for row in partial["tables"][0]["rows"]] == ["mesh_wrapping", "mean_colour"]
    stamp = (tmp_path / "killed/rows/mesh_wrapping/row.json").stat().st_mtime_ns
    page = compared("killed", methods).run()
    assert (tmp_path / "killed/rows/mesh_wrapping/row.json").stat().st_mtime_ns == stamp
    assert figures_of(tmp_path / "killed") == figures_of(tmp_path / "whole")
    assert [line.name for line in page.tables[0].lines] == ["mesh_wrapping", "mesh_texture", "mean_colour"]
    assert {table.split for table in page.tables} == {"novel_pose", "test"}
    for name in ("tables.md", "tables.html", "grid.png", "errors.png"):
        assert (tmp_path / "whole" / name).stat().st_size > 500
    assert "Mean colour" in (tmp_path / "whole/tables.md").read_text()


def test_other_settings_are_refused_before_anything_is_done(compared, own, tmp_path):
    compared("out", (own,)).run()
    with pytest.raises(LiveHandError, match=r"another budget.*--redo mean_colour"):
        compared("out", (own,), budget=Budget(steps=3)).run()
    (tmp_path / "out/rows/mean_colour/left").touch()
    page = compared("out", (own,), budget=Budget(steps=3), redo=("mean_colour",)).run()
    assert page.tables[0].lines[0].figures["steps"] == 3
    assert not (tmp_path / "out/rows/mean_colour/left").exists()
    with pytest.raises(LiveHandError, match="another version"):
        compared("out", (replace(own, version=2),), budget=Budget(steps=3)).run()


def test_rows_that_are_done_stay_in_the_tables(compared, own):
    compared("out", (own,)).run()
    page = compared("out", (WRAPPING, own), wanted=("mesh_wrapping",)).run()
    assert [line.name for line in page.tables[0].lines] == ["mesh_wrapping", "mean_colour"]


def test_a_row_that_fails_is_remarked_upon(compared, own, monkeypatch, tmp_path):
    def fail(self, *arguments):
        raise LiveHandError("no weights, give some")

    monkeypatch.setattr(type(own), "fit", fail)
    comparison = compared("out", (own, WRAPPING))
    page = comparison.run()
    assert comparison.remarks == ["row `mean_colour` is missing: no weights, give some"]
    assert [line.name for line in page.tables[0].lines] == ["mesh_wrapping"]
    assert "no weights" in (tmp_path / "out/tables.html").read_text()


def test_rows_are_timed_in_turns_and_once(compared, own, monkeypatch, tmp_path):
    calls = []
    measure = run_module.measure_speed
    monkeypatch.setattr(run_module, "measure_speed", lambda *given: calls.append(list(given[0])) or measure(*given))
    plan = {"speed": SpeedPlan((24, 32), 3)}
    line = compared("out", (own,), **plan).run().tables[0].lines[0]
    assert line.figures["ms"] > 0
    assert line.figures["core_s"] >= 0
    compared("out", (own,), **plan).run()
    assert calls == [["mean_colour"]]
    compared("out", (WRAPPING, own), **plan).run()
    assert calls[1] == ["mesh_wrapping", "mean_colour"]
    assert json.loads((tmp_path / "out/rows/mean_colour/speed.json").read_text())["frames"] == 3


def test_a_lit_capture_is_refused(compared, own, capture, hand):
    lit = replace(capture, lights=(CaptureLight("soft", Light()),))
    known = compared("out", (own,))
    with pytest.raises(LiveHandError, match="baked in"):
        Comparison(known._plan, lit, hand, Path(), known._machine, Measures())


def test_misfit_levels_have_two_arms_and_a_gap_to_their_own_zero(compared, own, capture, hand):
    rows = tuple(Row(own, ("misfit",), Misfit(level)) for level in (0.0, 2.0))
    page = compared("out", (), rows=rows, wanted=tuple(row.name for row in rows)).run()
    assert {table.split for table in page.tables} == {
        f"{split}, arm {arm}" for split in ("novel_pose", "test") for arm in ("training", "tracking")
    }
    zero, two = page.tables[0].lines
    assert (zero.name, two.name) == ("mean_colour@0mm", "mean_colour@2mm")
    assert zero.figures["gap_db"] == 0
    assert two.figures["vertex_mm"] > zero.figures["vertex_mm"] + 0.5
    tracking = next(table for table in page.tables if table.split == "test, arm tracking")
    quiet, noisy = (line.figures["psnr_hand"] for line in tracking.lines)
    assert tracking.lines[1].figures["gap_db"] == noisy - quiet != 0
    assert "<svg" in page.html()


def test_the_best_of_a_column_is_bold_and_published_figures_stand_beside():
    lines = [Line(name, name, {"psnr_full": psnr, "vgg19": vgg}, "") for name, psnr, vgg in
             (("mesh_wrapping", 20.001, 0.5), ("a_nerf", 20.004, 0.3), ("own", 19.0, 0.4))]  # fmt: skip
    heading, *rows = Table("comparison", "novel_pose", tuple(lines)).cells()
    assert heading == ["row", "P: PSNR dB", "P: LPIPS x1000", "P: FID", "P: FPS, RTX 3090", "PSNR dB", "VGG19"]
    assert rows[0] == ["mesh_wrapping", "**28.28**", "**49.44**", "**298.28**", "**82.33**", "**20.00**", "0.5000"]
    assert rows[1][1:] == ["28.07", "94.41", "318.61", "0.83", "**20.00**", "**0.3000**"]
    assert rows[2] == ["own", "", "", "", "", "19.00", "0.4000"]
    page = Page((Table("comparison", "novel_pose", tuple(lines)),), {"seed": "0"}, ("nothing <else>",))
    assert "<b>28.28</b>" in page.html()
    assert "nothing &lt;else&gt;" in page.html()
    assert "| own |" in page.markdown()
    assert "| HTML | yes | no | no | no |" in page.markdown()
    assert json.loads(page.json())["published"]["paper"]["psnr_db"] == 32.04


def test_the_detailed_part_is_on_the_hand_where_it_varies():
    truth = np.zeros((60, 50, 4), np.float32)
    truth[5:55, 5:45] = (0.5, 0.5, 0.5, 1)
    truth[40:50:2, 30:40, :3] = 0.9
    rows, columns = detailed_part(truth)
    assert (rows.stop - rows.start, columns.stop - columns.start) == (24, 20)
    assert rows.start <= 40
    assert rows.stop >= 50
    assert columns.start <= 30
    assert columns.stop >= 40


def test_pictures_are_kept(tmp_path):
    pairs = [(np.full((3, 2, 4), 0.25, np.float32), np.full((3, 2, 4), 1.5, np.float32))]
    save_pictures(pairs, tmp_path / "p.npz")
    ((truth, image),) = load_pictures(tmp_path / "p.npz")
    assert truth.max() == pytest.approx(0.25, abs=0.002)
    assert image.max() == 1
    assert load_pictures(tmp_path / "none.npz") == []
    np.savez(tmp_path / "other.npz", truth0=np.zeros((4, 4, 4)), image0=np.zeros((4, 4, 4)))
    (tmp_path / "cut.npz").write_bytes((tmp_path / "p.npz").read_bytes()[:-9])
    for name in ("other.npz", "cut.npz"):
        with pytest.raises(LiveHandError, match=name):
            load_pictures(tmp_path / name)


def test_rows_are_chosen_by_table_and_name(own):
    names = {row.name for row in chosen_rows(("comparison",), None)}
    assert names >= {"mesh_wrapping", "mesh_texture", "smplpix", "a_nerf", "lisa", "paper", "default"}
    assert {row.name for row in chosen_rows(("canonical",), None)} == {"paper", "no_pose", "xyz", "bones"}
    assert {row.name for row in chosen_rows(("components",), ["bilinear", "no_sr"])} == {"bilinear", "no_sr"}
    (row,) = chosen_rows(("comparison", "canonical", "components"), ["paper"])
    assert row.tables == ("comparison", "canonical", "components")
    levels = [row.name for row in chosen_rows(("misfit",), ["default"])]
    assert levels == [
        "default@0mm",
        "default@0.5mm",
        "default@1mm",
        "default@2mm",
        "default@4mm",
        "default@beta",
        "default@smooth",
    ]
    assert (
        chosen_rows(("comparison",), ["paper"], avatars=AvatarSettings(16))[0].method.config.sampler.samples_per_ray
        == 16
    )
    assert len({method.name for method in METHODS}) == len(METHODS)
    for wrong in ((("tables",), None), (("comparison",), ["nerf"])):
        with pytest.raises(LiveHandError, match="must be of"):
            chosen_rows(*wrong)
    with pytest.raises(LiveHandError, match="two of 'paper'"):
        chosen_rows(("comparison",), None, [replace(own, name="paper")])


def test_the_papers_loss_keeps_what_a_row_leaves_out():
    rows = chosen_rows(("components",), None, avatars=AvatarSettings(has_loss_of_paper=True, patch_px=32))
    loss = {row.name: row.method.loss for row in rows if isinstance(row.method, AvatarRow)}
    for name in ("no_sr_full", "paper", "bilinear"):
        assert (loss[name].colour_l2, loss[name].colour_l1, loss[name].perceptual) == (1, 0, 1)
    assert (loss["no_sr"].perceptual, loss["no_sr"].low_l2, loss["no_sr"].colour_l2) == (0, 0, 1)
    assert (loss["no_sr_full"].low_l2, loss["paper"].low_l2) == (0, PAPER.loss.low_l2)
    patch = loss["no_sr_patch"]
    assert (patch.perceptual_region, patch.perceptual_patch_px, patch.perceptual) == ("patch_all", 32, 1)
    assert {row.method.loss for row in chosen_rows(("components",), ["paper"])} == {FROM_THE_START}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("own_method:GONE", "can be imported"),
        ("no_such:ROW", "can be imported"),
        ("own_method:NOT_A_METHOD", "must have name"),
    ],
)
def test_what_is_no_method_is_refused(own, text, message):
    with pytest.raises(LiveHandError, match=message):
        load_own_method(text)
    assert Fitted(1, 1.0, 1).remarks == ""


def compare(*arguments):
    return run_commands("livehand", "", COMMANDS, ["compare", *map(str, arguments)])


def test_the_command_lists_and_compares(capture, own, tmp_path, monkeypatch, capsys):
    folder = tmp_path / "capture"
    shutil.copytree(capture.folder, folder)
    save_capture_index(replace(capture, folder=folder))
    monkeypatch.syspath_prepend(HERE)
    assert compare(folder, "--list", "--method", "own_method:ROW", "--steps", 200) == 0
    out = capsys.readouterr().out
    assert "mean_colour" in out
    assert "together" in out
    arguments = (
        folder,
        "-o",
        tmp_path / "out",
        "--method",
        "own_method:ROW",
        "--without-perceptual",
        "--device",
        "cpu",
    )
    arguments += ("--rows", "mean_colour", "--steps", 2, "--speed-size", "24x32", "--speed-frames", 2)
    assert compare(*arguments, "--json") == 0
    result = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert (result["rows"], result["missing"]) == (1, [])
    with Image.open(tmp_path / "out/grid.png") as grid:
        assert grid.size[0] == 2 * (24 + 2 + 20 + 2)  # two views, and a part of each at twice its size
    assert compare(*arguments, "--rows", "nobody") == 1
    assert "must be of" in capsys.readouterr().err
    assert compare(folder) == 1
    assert "-o DIR" in capsys.readouterr().err
    assert compare(folder, "--tables", "best") == 2
