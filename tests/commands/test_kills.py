"""A command that is killed just before an output gets its name ends, run again, in the same bytes.

Runs of evaluate.py and train.py that are killed are in test_engine.py and test_train.py.
"""

import re
import shutil
import signal
import sys
from importlib import import_module
from pathlib import Path

import pytest
from conftest import ROOT, Command, cases, exhaustive, files_in, run_process

DIE = """
import os, signal, sys
from importlib import import_module
from pathlib import Path
rename = Path.replace
def replace(self, target):
    if Path(target).name == stop:
        os.kill(os.getpid(), signal.SIGKILL)
    return rename(self, target)
Path.replace = replace
_, stop, module, *words = sys.argv
sys.argv = [module, *words]
import_module(module).main()
"""
RANDOM = re.compile(rb"(?s)\x73\xa4\x90.{16}|[\x73\x63]\xc5\x88.{8}|\xbf\x84.{4}")
"""Elements at the start of a Matroska file: SegmentUID, TrackUID, TagTrackUID, CRC-32."""
STILLS = "--frames 2 --width 256 --height 192"
FILM = "--message hi --seconds 0.5 --size 160 120"
SEND = f"{ROOT / 'docs' / 'ablation.png'} --message hello --preset paper "
SEND += "--rows 5 --cols 6 --ratex 2 --width 120 --height 80 --size 240x160"


def written(folder: Path) -> dict[Path, bytes]:
    """Content of every file, hidden ones included, without what an .mkv draws at random."""
    return {
        path: RANDOM.sub(b"", data[:4096]) + data[4096:] if path.suffix == ".mkv" else data
        for path, data in files_in(folder).items()
    }


@pytest.mark.slow
@cases(
    exhaustive("data_gen.__main__", STILLS, "out", "00001_original.png"),
    ("data_gen.video", FILM, "out.mkv", "out.jsonl"),
    ("sender.__main__", SEND, "out", "sent.json"),
)
def test_a_killed_command_ends_in_the_same_bytes(
    module: str, words: str, out: str, stop: str, command: Command, tmp_path: Path
) -> None:
    line = [*words.split(), "--out", tmp_path / "work" / out]
    work = tmp_path / "work"  # always the same place, because results name it
    work.mkdir()
    command(import_module(module).main, *line)
    undisturbed = written(work)
    shutil.rmtree(work)
    work.mkdir()
    run_process(sys.executable, "-c", DIE, stop, module, *line, status=-signal.SIGKILL)
    assert any(path.name.endswith("lock") for path in files_in(work))
    command(import_module(module).main, *line)
    assert written(work) == undisturbed
