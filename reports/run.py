"""The folder of a run of evaluate.py: each of its files is written, read and checked here.

| file | content |
|---|---|
| config.json | the settings that decide the result; written first |
| predictions.jsonl, metrics.json, metrics.csv, tables.md | the main comparison |
| *.jsonl.part | predictions of a run that is under way or was cut off (`reports.engine.predict`) |
| stories.json, stories/ | the captures that are read worst, as pictures |
| films.json | what the receiver saw of films, and where bits are wrong |
| run.json | command, versions, machine; its presence marks a finished run |
| report.html | the page |
"""

import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from link.errors import InputError, ParameterError
from link.files.lock import LOCK
from link.images import make_folder, write_bytes
from link.outside import inside, is_file, parse_json, read_json
from reports.captured.door import FILMS
from reports.captured.evidence import FilmEvidence
from reports.engine.checked import Number, checked, write_json
from reports.engine.provenance import Machine, Making, commit, machine
from reports.engine.records import read_predictions
from reports.score.accuracy import STORED, score, write_scores

T = TypeVar("T")
MAX_PICTURE_BYTES = 64 * 2**20
"""Largest size, in bytes, of a picture of a stored run that the report shows."""
REPORT = "report.html"
"""Name of the page of a run."""
PREDICTIONS, STORIES = "predictions.jsonl", "stories.json"
"""Names of the files of the predictions, and of the pictures."""
CSV = "metrics.csv"
"""Name of the file of the scores that spreadsheets and pandas read: a row a cell and method."""
CONFIG = "config.json"
"""Name of the file in a run's folder that holds its settings; it is written first."""


@dataclass(frozen=True)
class Story:
    """One capture as the report shows it."""

    method: str
    """Label of the method that read it."""
    where: str
    """Source of the capture, in words."""
    pictures: list[tuple[str, str]]
    """File in the run's folder, and caption."""


@dataclass(frozen=True)
class About:
    """How, when and where a run was made."""

    meta: dict[str, Any]
    """Command, versions, seed and whether it is simulated, as
    `reports.engine.provenance.provenance` gives them."""
    commit: str
    """Commit of the checkout; empty where there is no git."""
    machine: Machine
    """Machine that made the run."""
    settings: dict[str, Any]
    """Settings of the run, as config.json holds them."""
    seconds: dict[str, Number]
    """Seconds that were spent, by what took them."""
    notes: list[str]
    """Notes for the reader: methods that were left out, cells that failed."""


@dataclass(frozen=True)
class Run:
    """Everything of one finished run."""

    folder: Path
    """Folder of the run."""
    about: About
    """How the run was made."""
    records: pd.DataFrame
    """Predictions of the main comparison."""
    scores: pd.DataFrame
    """Score table of the main comparison."""
    stories: list[Story]
    """Captures that the report shows as pictures."""
    films: FilmEvidence | None
    """Measurements of the receiver on films; None where no film was received."""

    @property
    def seed(self) -> int:
        """Seed of the captures; it also seeds the resamples of paired comparisons."""
        return int(self.about.meta["seed"])

    @property
    def simulated(self) -> bool:
        """Whether the captures are simulated."""
        return bool(self.about.meta["simulated"])

    @property
    def from_folder(self) -> bool:
        """Whether the captures lay in a folder (``--captures``): their channel is not known."""
        return bool(self.about.settings.get("captures"))

    @property
    def by_condition(self) -> dict[str, "Run"]:
        """The run of each condition by itself, since conditions have different captures."""
        return {
            str(name): replace(
                self, records=mine, scores=self.scores[self.scores["condition"] == name]
            )
            for name, mine in self.records.groupby("condition", sort=False)
        }

    @property
    def methods(self) -> list[str]:
        """Labels of the methods, as they were named on the command line."""
        return [str(name) for name in self.scores["method"].unique()]


def claim_folder(
    folder: Path, settings: dict[str, Any], part: str = "", ignored: Sequence[str] = ()
) -> None:
    """Write a run's settings to config.json before any work, or refuse what is no run's folder.

    Call it while `link.files.lock.locked` keeps others out of the folder.

    Args:
        folder: is made if it is not there.
        settings: all that decides the result; what JSON does not know is written as text.
        part: key of config.json under which the settings stand, where the run adds more to the
            file at its end; empty where the file holds the settings alone.
        ignored: settings that decide no result, in which two runs may differ.

    Raises:
        InputError: the folder holds other files and not this config.json, or cannot be written.
    """
    make_folder(folder)
    file = folder / CONFIG
    content = {part: settings} if part else settings
    text = json.dumps(content, indent=2, default=str) + "\n"

    def deciding(content: Any) -> Any:
        found = content.get(part) if part and isinstance(content, dict) else content
        if not isinstance(found, dict):
            return found
        return {name: value for name, value in found.items() if name not in ignored}

    stored, mine = None, deciding(parse_json(text, "a run's settings"))
    with suppress(InputError):
        stored = deciding(read_json(file))
    if stored == mine:
        return
    alike = isinstance(stored, dict) and stored.keys() == mine.keys()  # a run that left no more
    replaced = (CONFIG, LOCK) if alike else (LOCK,)
    if any(other.name not in replaced for other in folder.iterdir()):
        raise ParameterError(
            "out", f"{folder} holds a run with other settings, or other files; name a new folder"
        )
    write_bytes(file, text.encode())


@dataclass
class RunFolder:
    """Writes a run's files, and reads them back."""

    path: Path
    """The folder; made where it does not exist."""
    settings: dict[str, Any] = field(default_factory=dict)
    """All that decides the result; known once the folder is claimed."""

    def claim(self, settings: dict[str, Any]) -> None:
        """Write the settings, or refuse a folder that holds the results of other settings.

        Args:
            settings: all that decides the result.

        Raises:
            InputError: the folder belongs to another run, or cannot be written.
        """
        claim_folder(self.path, settings)
        self.settings = json.loads(json.dumps(settings, default=str))

    def write_comparison(self, records: pd.DataFrame, meta: dict[str, Any], tables: str) -> None:
        """Score the main comparison: metrics.json, its rows as CSV, tables.md.

        Args:
            records: predictions, which lie in the folder already.
            meta: what `reports.engine.provenance.provenance` says.
            tables: Markdown.
        """
        scores = score(records)
        write_scores(self.path / "metrics.json", scores, meta)
        write_bytes(self.path / CSV, scores[STORED].to_csv(index=False).encode())
        write_bytes(self.path / "tables.md", f"{tables}\n".encode())

    def finish(
        self,
        meta: dict[str, Any],
        seconds: dict[str, float],
        notes: Sequence[str],
        **stated: str,
    ) -> None:
        """Write run.json, the mark of a finished run.

        Args:
            meta: what `reports.engine.provenance.provenance` says.
            seconds: time by what took it.
            notes: what a reader must know.
            **stated: settings that run.json says otherwise than config.json, such as the digest of
                a manifest in place of its folder.
        """
        rounded = {name: round(value, 1) for name, value in seconds.items()}
        settings = {**self.settings, **stated}
        about = About(meta, commit(), machine(), settings, rounded, list(notes))
        write_json(self.path / "run.json", about)

    def read(self) -> Run:
        """Read a finished run.

        Raises:
            InputError: it is not there, not finished, or damaged.
        """
        if not all(is_file(self.path / name) for name in ("run.json", PREDICTIONS)):
            raise InputError(
                f"{self.path}: holds no finished run; first python evaluate.py --out {self.path}"
            )
        try:
            records = read_predictions(self.path / PREDICTIONS)
            about = checked(About, read_json(self.path / "run.json"), "run.json")
            run = Run(
                folder=self.path,
                about=about,
                records=records,
                scores=score(records, in_paper=not about.settings.get("films")),
                stories=self._read(STORIES, list[Story]) or [],
                films=self._read(FILMS, FilmEvidence),
            )
            checked(Making, run.about.meta, "run.json, meta")
            checked(dict[str, str], run.about.settings.get("checkpoints", {}), "run.json, settings")
            for _, picture in run.films.maps if run.films else ():
                inside(self.path, picture, FILMS)
            for story in run.stories:
                for picture, _ in story.pictures:
                    inside(self.path, picture, f"{STORIES}, {story.where:.60}")
        except (OSError, InputError) as error:
            reason = " ".join(str(error).split())
            raise InputError(
                f"{self.path}: a file of the run is missing or damaged ({reason:.300})"
            ) from None
        return run

    def _read(self, name: str, kind: type[T]) -> T | None:
        """Content of a file, checked against its type; None where there is no such file."""
        file = self.path / name
        return checked(kind, read_json(file), name) if is_file(file) else None
