"""Kill commands at random moments and run them again: python -m tests.kills --kills 30 --seed 0.

Each command runs undisturbed first, twice. Then it is started again and again in an empty folder,
and killed with all its processes (SIGKILL) at a moment drawn evenly from the time that it takes;
every fourth time the run after that is killed, too. Besides, it is killed just before some of its
files get their names. The same command then runs to its end. A case fails where that run is
refused or fails, where a file differs from that of the undisturbed run, or where anything else is
left, hidden files included.

An .mkv holds random identifiers, which FFmpeg draws, and check sums of them; these are left out.
Two files of evaluate.py hold measured times, cost.json and run.json. They are compared without the
times. report.html shows the times, so it is made again from the times of the undisturbed run, and
is then compared as it is. All other files must have the same bytes.

Runs are forked from a process that has all modules loaded. The settings are the smallest that go
through all stages: train.py evaluates one cell with two methods, compares its export on two frame
pairs, and takes the graph that the undisturbed run traced. The code must not change meanwhile.
Prints a line of JSON for each command; exit status 1 where a case failed.
"""

import argparse
import hashlib
import importlib
import json
import os
import random
import re
import shutil
import signal
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from link.images import write_bytes
from tests.forked import Ended, run_forked

ROOT = Path(__file__).parents[1]
GRID = "--rows 4 --cols 4 --width 256 --height 192"
FILM = "--message hi --seconds 0.5 --size 160 120"
SEND = "{root}/docs/ablation.png --message hello --preset paper "
SEND += "--rows 5 --cols 6 --ratex 2 --width 120 --height 80 --size 240x160"
COMMANDS = {
    "train": ("train", "--episodes 2 --rounds 3 --steps 2 --batch 4 --frames 1 --jobs 1"),
    "evaluate": (
        "evaluate",
        "--pairs canon-lg --views 0 45 --kappas 3 --frames 1 --methods naive oorc "
        "--sweeps ratex --quick --jobs 1",
    ),
    "data_gen": ("data_gen.__main__", f"--frames 6 {GRID}"),
    "film_folder": ("data_gen.video", FILM),
    "film_mkv": ("data_gen.video", FILM),
    "send_player": ("sender.__main__", SEND),
    "send_mkv": ("sender.__main__", SEND),
    "send_folder": ("sender.__main__", SEND),
}
"""Module and flags of each command by a name whose end says the ending of its output."""
ENDINGS = {"player": ".html", "mkv": ".mkv"}
STOPS = {
    "data_gen": ("00001_original.png", "manifest.jsonl"),
    "film_folder": ("000002.png", "truth.jsonl"),
    "film_mkv": ("out.jsonl",),
    "send_player": ("out.html",),
    "send_mkv": ("out.mkv",),
    "send_folder": ("sent.json", "out"),
}
"""Files and folders of each command before which it is killed."""
CACHE = "OORC_TRACED_GRAPHS"
"""Environment variable that names the folder of graphs that were traced before."""
LIMIT_S = 300.0
"""Seconds after which a run counts as hung."""
TIMES: dict[str, Callable[[Any], Any]] = {
    "run.json": lambda about: {**about, "seconds": sorted(about["seconds"])},
    "cost.json": lambda cost: [cost["rounds"], cost["reference"], sorted(cost["ratios"])],
}
"""What is compared of the files that hold measured times."""
RANDOM = re.compile(rb"(?s)\x73\xa4\x90.{16}|[\x73\x63]\xc5\x88.{8}|\xbf\x84.{4}")
"""Elements at the start of a Matroska file: SegmentUID, TrackUID, TagTrackUID, CRC-32."""


class Place:
    """A folder where one command runs, always the same one, because results name it."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.work = folder / name, folder / name / "work"
        module, words = COMMANDS[name]
        self.main: Callable[[], None] = importlib.import_module(module).main
        self.out = self.work / f"out{ENDINGS.get(name.rpartition('_')[2], '')}"
        self.words = [module, *words.format(root=ROOT).split(), "--out", str(self.out)]

    def empty(self) -> None:
        """Begin anew, with an empty folder."""
        shutil.rmtree(self.folder, ignore_errors=True)
        self.work.mkdir(parents=True)
        (self.folder / "tmp").mkdir()

    def run(self, kill_s: float = LIMIT_S, words: list[str] | None = None, stop: str = "") -> Ended:
        """Run the command; it is killed after some seconds, or before ``stop`` gets its name."""

        def prepare() -> None:
            os.environ["TMPDIR"] = tempfile.tempdir = str(self.folder / "tmp")
            if stop:
                die_before(stop)

        return run_forked(self.main, words or self.words, self.work, self.folder, kill_s, prepare)

    def files(self) -> dict[str, Any]:
        """Content of every file, by its path; None for a folder, times left out."""
        return {
            str(path.relative_to(self.work)): self._content(path) for path in self.work.rglob("*")
        }

    def _content(self, path: Path) -> Any:
        if not path.is_file():
            return None
        data = path.read_bytes()
        if path.suffix == ".mkv":
            return RANDOM.sub(b"", data[:4096]) + data[4096:]
        return TIMES[path.name](json.loads(data)) if path.name in TIMES else data

    def show_times_of(self, stored: Path) -> None:
        """Make a report again with the times of another run of the same command."""
        if (self.out / "run.json").is_file():
            for name in TIMES:
                shutil.copyfile(stored / name, self.out / name)
            self.run(words=["evaluate", "--report", str(self.out)])


def die_before(name: str) -> None:
    """Let this process kill itself just before a file or folder gets that name."""
    rename = Path.replace

    def replace(self: Path, target: str | Path) -> Path:
        if Path(target).name == name:
            os.kill(os.getpid(), signal.SIGKILL)
        return rename(self, target)

    Path.replace = replace  # type: ignore[method-assign]


def differences(expected: dict[str, Any], found: dict[str, Any]) -> list[str]:
    """What is missing, stray or other, in words."""
    return [
        *(f"missing: {name}" for name in sorted(expected.keys() - found.keys())),
        *(f"stray: {name}" for name in sorted(found.keys() - expected.keys())),
        *(f"differs: {name}" for name in sorted(expected) if name in found
          and found[name] != expected[name]),
    ]  # fmt: skip


def cached_export(module: Any, path: Path, *arguments: Any) -> Any:
    """Export a decoder as train.py does, but trace its graph, which takes long, only once."""
    to_onnx: Any = importlib.import_module("export.to_onnx")
    trace = to_onnx.to_onnx
    weights = hashlib.sha256((path.parent / "decoder.pt").read_bytes()).hexdigest()
    cached = Path(os.environ[CACHE]) / weights

    def traced(*words: Any) -> bytes:
        if not cached.is_file():
            write_bytes(cached, trace(*words))
        return cached.read_bytes()

    to_onnx.to_onnx = traced
    return to_onnx.export(module, path, *arguments)


def shrink_training(folder: Path) -> None:
    """Let train.py evaluate one cell with two methods, and compare its export on two pairs."""
    trained: Any = importlib.import_module("reports.evaluation.trained")
    os.environ[CACHE] = str(folder)
    trained.export = cached_export
    paper_cells = trained.paper_cells
    trained.PARITY_FRAMES = 2
    trained.DECODERS = ("naive", "learned")
    trained.paper_cells = lambda pairs: paper_cells(pairs, (0.0,), (3,))


def try_command(name: str, kills: int, rng: random.Random, folder: Path, out: Path | None) -> bool:
    """Kill one command so many times, and print what became of it; whether nothing failed."""
    place = Place(folder, name)
    undisturbed: list[dict[str, Any]] = []
    seconds = LIMIT_S
    for _ in range(2):
        place.empty()
        ended = place.run()
        if ended.status:
            sys.exit(f"{name}: the undisturbed run failed: {ended.stderr}")
        if not undisturbed and place.out.is_dir():
            shutil.copytree(place.out, folder / f"{name}_stored")
        place.show_times_of(folder / f"{name}_stored")
        undisturbed.append(place.files())
        seconds = min(seconds, ended.seconds)
    expected = undisturbed[0]
    failed = [f"undisturbed {line}" for line in differences(*undisturbed)]
    done = twice = ended_first = refused = compared = 0

    def go_on(killed: str) -> None:
        """Run to the end what was killed, and compare what is left then."""
        nonlocal refused, compared
        left = sorted(place.files())
        ended = place.run()
        wrong = []
        if ended.status == 2 and "already" in ended.stderr:  # it was killed once all was written
            refused += 1
        elif ended.status:
            wrong.append(f"status {ended.status}: {ended.stderr.strip()[-300:]}")
        place.show_times_of(folder / f"{name}_stored")
        wrong += differences(expected, place.files())
        compared += len(expected)
        if wrong:
            failed.extend(f"killed {killed}: {line}" for line in wrong)
            print(name, killed, *wrong, "left:", *left, sep="\n  ", flush=True)
            if out is not None:
                shutil.copytree(place.work, out / f"{name}_{len(failed)}", symlinks=True)

    for number in range(10 * kills):
        if done >= kills:
            break
        place.empty()
        moments = []
        for _ in range(2 if number % 4 == 3 else 1):
            moments.append(round(rng.uniform(0, seconds), 3))
            killed = place.run(moments[-1]).status == -signal.SIGKILL
            done, ended_first = done + killed, ended_first + (not killed)
        twice += len(moments) - 1
        go_on(f"at {moments} of {seconds:.2f} s")
    stops = STOPS.get(name, ())
    for stop in stops:
        place.empty()
        if place.run(stop=stop).status != -signal.SIGKILL:
            failed.append(f"never made {stop}")
        if not any(path.endswith("lock") for path in place.files()):
            failed.append(f"no lock at {stop}")
        go_on(f"before {stop}")
    counts = {"command": name, "seconds": round(seconds, 1), "kills": done, "stops": len(stops)}
    counts |= {"twice_in_a_row": twice, "ended_before_the_kill": ended_first}
    counts |= {"was_complete": refused, "files": len(expected), "files_compared": compared}
    print(json.dumps(counts | {"failures": failed}), flush=True)
    return not failed


def main() -> None:
    """Kill the commands and print what failed."""
    parser = argparse.ArgumentParser(prog="python -m tests.kills", description=__doc__)
    parser.add_argument("--kills", type=int, default=30, help="of each command")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--commands", nargs="*", choices=list(COMMANDS), default=list(COMMANDS))
    parser.add_argument("--out", type=Path, help="folder for what failed cases left")
    config = parser.parse_args()
    importlib.import_module("reports.engine.backends").one_thread()
    rng = random.Random(config.seed)
    with tempfile.TemporaryDirectory() as temporary:
        if "train" in config.commands:
            shrink_training(Path(temporary) / "traced")
        results = [
            try_command(name, config.kills, rng, Path(temporary), config.out)
            for name in config.commands
        ]
    sys.exit(0 if all(results) else 1)


if __name__ == "__main__":
    main()
