"""The table of exit codes in docs/use/exit_codes.md: every command, every code."""

import re
from dataclasses import replace
from pathlib import Path

import pytest
from livehand.backend.system import command as commands
from livehand.livehand_blender import blender_command, cli

PAGE = (Path(__file__).parents[2] / "docs" / "use" / "exit_codes.md").read_text(encoding="utf-8")
TABLE = {
    name: tuple(int(code) for code in codes.split(", "))
    for name, codes in re.findall(r"^\| `([a-z-]+)` \| ([\d, ]+) \|", PAGE, re.MULTILINE)
}
CODES = {int(code) for code in re.findall(r"^\| (\d+) \|", PAGE, re.MULTILINE)}
# Arguments with which a command fails: NO is nothing.
FAILING = {
    "render": "NO.blend -o OUT",
    "make-hand": "NO.fbx -o OUT.npz",
    "capture": "-o OUT --hand NO.npz",
    "lookdev": "-o OUT --hand NO.npz",
    "train": "NO -o OUT.safetensors",
    "evaluate": "NO",
    "compare": "NO -o OUT",
    "benchmark": "--avatar NO.safetensors",
    "sheet": "NO",
    "inspect": "NO",
    "thumbnail": "NO.safetensors",
    "import-interhand": "NO -o OUT --hand NO.npz --capture 0",
    "import-transforms": "NO --poses NO -o OUT",
    "mask": "NO",
    "fetch-tracker": "--weights NO",
    "fetch-perceptual": "--weights NO",
    "person": "NO -o OUT.safetensors",
    "new-person": "--age 200 -o OUT.safetensors",
    "adjust-person": "NO --tone 0.5 -o OUT.safetensors",
    "track": "NO -o OUT.npz",
    "reenact": "NO -o OUT",
    "export": "NO -o OUT.csv",
    "consistency": "NO.safetensors",
    "extract-mesh": "NO.safetensors -o OUT.ply",
    "origin": "NO.png",
    "watermark": "NO.safetensors -o OUT.safetensors",
    "identity": "NO.safetensors --name ann -o OUT.safetensors",
    "sign": "NO.png --certificate NO.pem --private-key NO.pem",
    "warm-up": "",  # fails only where it cannot write
}
ROWS = [(name, code) for name, codes in TABLE.items() for code in codes]


def test_the_table_has_every_command_and_every_code():
    assert TABLE.keys() == cli.COMMANDS.keys() == FAILING.keys()
    assert set(blender_command._COMMANDS) <= TABLE.keys()
    known = {commands.OK, commands.FAILED, commands.USAGE, commands.OTHER_VERSION, commands.INTERRUPTED}
    assert known == CODES == {code for codes in TABLE.values() for code in codes}


@pytest.fixture
def run(tmp_path, monkeypatch):
    """A function (command, what its run does instead, more arguments) -> the exit code."""

    def run(name, instead=None, *more):
        if instead is not None:
            monkeypatch.setitem(cli.COMMANDS, name, replace(cli.COMMANDS[name], run=instead))
        arguments = FAILING[name].replace("NO", str(tmp_path / "none")).replace("OUT", str(tmp_path / "out"))
        return cli.main([name, *arguments.split(), *more])

    return run


def interrupted(args):
    raise KeyboardInterrupt


@pytest.mark.parametrize(("name", "code"), ROWS)
def test_a_command_ends_with_each_of_its_codes(run, capsys, name, code):
    if code == commands.OK:
        assert run(name, lambda args: {}) == code
    elif code == commands.FAILED and FAILING[name]:
        assert run(name) == code
        err = capsys.readouterr().err.strip().splitlines()
        assert err[-1].startswith(f"livehand {name}: ")
        assert "Traceback" not in err
    elif code == commands.USAGE:
        assert run(name, None, "--no-such-option") == code
    elif code == commands.INTERRUPTED:
        assert run(name, interrupted) == code
        assert capsys.readouterr().err == f"livehand {name}: interrupted\n"


def test_only_render_refuses_frames_of_another_version(shot_path, tmp_path, fake_session):
    assert [name for name, codes in TABLE.items() if commands.OTHER_VERSION in codes] == ["render"]
    assert cli.main(["render", str(shot_path), "-o", str(tmp_path / "out"), "--frames", "1"]) == 0
    (tmp_path / "out" / "wave_0001.json").unlink()
    command = ["render", str(shot_path), "-o", str(tmp_path / "out"), "--frames", "1", "--strict"]
    assert cli.main(command) == commands.OTHER_VERSION
