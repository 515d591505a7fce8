"""A finished run as it lies in its folder: all that the report and the comparison of runs need."""

import json
import os
import platform
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from link.errors import InputError
from link.images import write_bytes
from reports.engine.predict import PREDICTIONS, read_predictions
from reports.evaluation.cost import read_cost
from reports.evaluation.response import Response, read_responses
from reports.evaluation.stories import Story, read_stories
from reports.score.metrics import Row, read_metrics, score
from reports.studies.sweeps import SWEEPS_JSON, read_sweeps

RUN_JSON = "run.json"
ROOT = Path(__file__).parent.parent
REFERENCES = {
    "ablation": "docs/ablation.json",
    "peers": "docs/peers.json",
    "prediction": "docs/prediction.json",
}
"""Results of other commands that the report shows; copied beside the run's own."""


@dataclass(frozen=True)
class SweepPoint:
    """One value of a sweep, decoded."""

    sweep: str
    value: float
    view_deg: float
    kappa: int
    predictions: list[dict[str, Any]]
    rows: list[Row]


@dataclass(frozen=True)
class Run:
    """Everything of one finished run."""

    folder: Path
    about: dict[str, Any]
    """run.json: command, versions, machine, commit, settings, notes."""
    predictions: list[dict[str, Any]]
    rows: list[Row]
    sweeps: list[SweepPoint]
    sweep_texts: dict[str, dict[str, Any]]
    """By sweep: title, axis, note, as of `sweeps.Sweep`."""
    stories: list[Story]
    responses: list[Response]
    cost: dict[str, Any] | None
    references: dict[str, dict[str, Any]]

    @property
    def simulated(self) -> bool:
        """Whether the captures are."""
        return bool(self.about["meta"]["simulated"])

    @property
    def from_folder(self) -> bool:
        """Whether the captures lay in a folder (`--captures`): their channel is not known here."""
        return bool(self.about["settings"].get("captures"))

    @property
    def methods(self) -> list[str]:
        """As they were named on the command line."""
        return list(dict.fromkeys(row.method for row in self.rows))


def finish(
    folder: Path,
    meta: Mapping[str, Any],
    settings: Mapping[str, Any],
    seconds: Mapping[str, float],
    notes: Sequence[str] = (),
) -> None:
    """Write run.json, the mark of a finished run, and copy the results of `REFERENCES`."""
    for name, source in REFERENCES.items():
        if (ROOT / source).is_file():
            target = folder / "reference" / f"{name}.json"
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / source, target)
    about = {
        "meta": dict(meta),
        "commit": commit(),
        "machine": machine(),
        "settings": dict(settings),
        "seconds": {name: round(value, 1) for name, value in seconds.items()},
        "notes": list(notes),
    }
    write_bytes(folder / RUN_JSON, (json.dumps(about, indent=1, default=str) + "\n").encode())


def read_run(folder: Path) -> Run:
    """Read a folder that `finish` closed.

    Raises:
        InputError: it is not there, not finished, or damaged.
    """
    if not (folder / RUN_JSON).is_file() or not (folder / PREDICTIONS).is_file():
        raise InputError(
            f"{folder}: holds no finished run; first python evaluate.py --out {folder}"
        )
    try:
        about = json.loads((folder / RUN_JSON).read_text())
        predictions = list(read_predictions(folder))
        rows = score(predictions)
        stored, _ = read_metrics(folder / "metrics.json")
        sweeps = [
            SweepPoint(p["sweep"], p["value"], p["view_deg"], p["kappa"], lines, score(lines))
            for p, lines in read_sweeps(folder)
        ]
        texts = {}
        if (folder / SWEEPS_JSON).is_file():
            texts = json.loads((folder / SWEEPS_JSON).read_text())["sweeps"]
        references = {
            name: json.loads(file.read_text())
            for name in REFERENCES
            if (file := folder / "reference" / f"{name}.json").is_file()
        }
        run = Run(
            folder, about, predictions, rows, sweeps, texts, read_stories(folder),
            read_responses(folder), read_cost(folder), references,
        )  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise InputError(f"{folder}: a file of the run is missing or damaged ({error})") from None
    if stored != rows:
        raise InputError(f"{folder}: metrics.json does not score predictions.jsonl; run it again")
    return run


def commit() -> str:
    """Of the checkout, with a word if tracked files differ from it; empty without git."""

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
        )
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        head = git("rev-parse", "--short=12", "HEAD")
        changed = head and git("status", "--porcelain", "--untracked-files=no")
    except OSError:
        return ""
    return f"{head}, with changes" if changed else head


def machine() -> dict[str, Any]:
    """System, processor and number of cores; no name of the host."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(errors="replace").splitlines()
        model = next((line.split(":")[1].strip() for line in lines if "model name" in line), model)
    return {
        "system": f"{platform.system()} {platform.machine()}",
        "processor": model,
        "cores": os.cpu_count() or 1,
    }
