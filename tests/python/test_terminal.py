"""What people see on a terminal, and programs on a pipe: bars with the time left, colours, plain lines. Needs the program."""

import os
import pty
import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PROGRAM = Path(os.environ.get("MAMMOTWIN", ROOT / "target/release/mammotwin")).resolve()
pytestmark = pytest.mark.skipif(not PROGRAM.exists(), reason=f"{PROGRAM}: no program; build it, or set MAMMOTWIN")


def on_a_terminal(*arguments, **environment):
    """All that is written to a terminal of 100 columns."""
    try:
        ours, its = pty.openpty()
    except OSError as cause:
        pytest.skip(f"this machine has no terminals to give away (/dev/pts): {cause}")
    environment = {**os.environ, "TERM": "xterm", "COLUMNS": "100", **environment}
    process = subprocess.Popen([PROGRAM, *arguments], stdin=its, stdout=its, stderr=its, env=environment)
    os.close(its)
    told = b""
    try:
        while part := os.read(ours, 1 << 16):
            told += part
    except OSError:
        # The terminal is gone with its last process.
        pass
    process.wait()
    os.close(ours)
    return told.decode()


def synth(folder):
    return "synth", "--preset", "tiny", "--voxel-mm", "6", "--poses", "supine", "--out", folder


def test_a_bar_tells_the_time_left(tmp_path):
    told = on_a_terminal(*synth(tmp_path / "dv"))
    assert "█" in told and "taking the picture" in told
    assert re.search(r"\d+s, \d+s left", told)
    first = told.split("\r")[0]
    assert "synth" in first and "left" not in first, "nothing is known yet"


def test_without_a_terminal_there_are_plain_lines(tmp_path):
    done = subprocess.run([PROGRAM, *synth(tmp_path / "dv")], capture_output=True, text=True, check=True)
    assert done.stderr == "[1/1] synth ...\n"
    assert [line.split(":")[0] for line in done.stdout.splitlines()] == ["study", "truth"]


def test_an_error_has_colours_on_a_terminal_unless_they_are_not_wanted(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text("schema = 1\n[mesh]\nsize = 8.0\n")
    told = on_a_terminal("check", study)
    assert "\x1b[31m^^^^\x1b[0m" in told and "3 | size = 8.0" in told
    told = on_a_terminal("check", study, NO_COLOR="1")
    assert "\x1b" not in told and "  | ^^^^" in told
    done = subprocess.run([PROGRAM, "check", study], capture_output=True, text=True)
    assert done.returncode == 65 and "\x1b" not in done.stderr and len(done.stderr.splitlines()) == 1
