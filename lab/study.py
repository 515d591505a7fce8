"""Parts that all studies share: flags, a folder, how tasks run and resume, and the file of results.

A `Study` answers one question. It brings flags of its own, a function that measures, and what shows
the measured numbers: tables in Markdown, and pictures. `run_study` does the rest. It checks the
flags before any work, lets tasks run in parallel, keeps what they return so that a command that was
cut off goes on, writes one file of results, and shows it.
"""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, is_dataclass
from functools import partial
from inspect import getmodule
from pathlib import Path
from typing import Any, Generic, TypeVar, get_type_hints

import pandas as pd
import tyro
from matplotlib.figure import Figure

from link.cli import check_flags
from link.errors import InputError, at_least
from link.files.lock import locked
from link.images import write_bytes
from link.outside import read_json
from reports.engine.backends import Backend
from reports.engine.checked import checked, write_json
from reports.engine.digest import code_digest, file_digest, package_versions, short_digest
from reports.engine.methods import Method
from reports.engine.predict import Condition, predict_all
from reports.engine.provenance import Making, commit, provenance
from reports.engine.stored import resume
from reports.render.charts import save_png
from reports.render.tables import replace_block

T = TypeVar("T")
DOCS = Path("docs")
"""Folder of the documents, and of the results that they show."""
RUNS = Path("runs")
"""Folder in which each study has a folder of its own, where no other is named."""


@dataclass(frozen=True)
class StudyFlags:
    """Flags that every study has."""

    seed: int = 0
    """Seed of all random draws."""
    jobs: int = os.cpu_count() or 1
    """Number of processes on this machine."""
    scheduler: str | None = None
    """Address of a Dask scheduler, such as tcp://host:8786, whose workers run the tasks instead."""
    out: Path | None = None
    """Folder of the results, and of what is kept so that a run that was cut off goes on; runs/NAME
    by default."""
    keep: bool = False
    """Write the results into docs/ as well: the file of the results, the pictures, and the tables
    in the marked blocks of their page."""


F = TypeVar("F", bound=StudyFlags)
R = TypeVar("R")


@dataclass(frozen=True)
class Workshop:
    """Runs a study's tasks, and keeps their results."""

    out: Path
    """Folder of the study."""
    backend: Backend
    """Processes of this machine, or a Dask cluster."""

    def each(
        self, task: Callable[[T], R], items: Mapping[str, T], inputs: Sequence[Path] = ()
    ) -> dict[str, R]:
        """Run a task for each item whose result is not kept yet.

        Results are kept in a file that is named after the code of the task's module and of all that
        it imports, after the installed packages, and after the content of ``inputs``. The name of a
        kept result is the item's name and text, so that other flags find what they share.

        Args:
            task: function of a module that holds little else; it returns a dataclass or a plain
                value that JSON can hold, of the type that its annotation says.
            items: frozen dataclasses or plain values, whose text says all that decides a result, by
                a name for messages.
            inputs: files on whose content the results depend, such as trained decoders.

        Returns:
            the results by the items' names, in the order of the items.

        Raises:
            InputError: some tasks failed; the results of the others are kept.
        """
        module = getmodule(task)
        assert module is not None
        code = code_digest(module.__name__)
        mark = short_digest(code, *package_versions(), file_digest(inputs))
        file = self.out / f"{task.__name__}_{mark}.jsonl"
        keys = {name: f"{name} {short_digest(repr(item))}" for name, item in items.items()}
        named = {keys[name]: item for name, item in items.items()}
        title = task.__name__.replace("_", " ")
        results, failed = resume(partial(_plain, task), named, file, self.backend, title)
        if failed:
            reasons = "; ".join(f"{name}: {failure.reason}" for name, failure in failed.items())
            raise InputError(f"{title}: {len(failed)} of {len(items)} failed: {reasons}")
        kind: type[R] = get_type_hints(task)["return"]
        return {name: checked(kind, results[key], f"{file}, {name}") for name, key in keys.items()}

    def predict(self, conditions: Sequence[Condition], methods: Sequence[Method]) -> pd.DataFrame:
        """Decode every cell of every condition with every method.

        Returns:
            the table of predictions, as `reports.engine.records.to_records` describes it.

        Raises:
            InputError: a cell failed; the others are kept.
        """
        name = f"predictions_{short_digest(repr((conditions, methods)))}.jsonl"
        return predict_all(conditions, methods, self.out / name, self.backend)


def _plain(task: Callable[[T], Any], item: T) -> Any:
    """Run a task; a dataclass that it returns becomes an object, as JSON has it."""
    result = task(item)
    return asdict(result) if is_dataclass(result) else result  # type: ignore[arg-type]


@dataclass(frozen=True)
class Results(Generic[R]):
    """Content of a file of results."""

    meta: dict[str, Any]
    """Provenance of the numbers: at least the keys of `reports.engine.provenance.Making`, and the
    study's ``flags``."""
    content: R
    """Numbers that were measured."""


@dataclass(frozen=True)
class Study(Generic[F, R]):
    """A question, how it is answered, and how the answer is shown."""

    name: str
    """Name by which ``python -m lab`` runs it; also of its folders."""
    flags: type[F]
    """Dataclass of its flags, whose docstring the help begins with."""
    content: type[R]
    """Dataclass of the measured numbers, with fields that JSON can hold; files are checked against
    it."""
    measure: Callable[[F, Workshop], R]
    """Function that measures. Long work runs through the workshop, and so in parallel and
    resumable."""
    blocks: Callable[[Mapping[str, Results[R]]], Mapping[str, str]]
    """Function that writes results, by their label, as Markdown: texts by the name of a page's
    marked block."""
    label: Callable[[F], str]
    """Function that names the file of results, without its ending; it tells apart results of one
    study under other flags."""
    page: Path | None = None
    """Page of docs/ that has these blocks; None where no page shows them."""
    printed_alone: frozenset[str] = frozenset()
    """Names of the blocks that the command prints and the page leaves out."""
    pictures: Callable[[Mapping[str, Results[R]]], Mapping[str, Figure]] = lambda _: {}
    """Function that draws results, by their label: figures by the names of their PNG files."""
    check: Callable[[F], None] = lambda _: None
    """Function that raises an `InputError` for the first flag with a wrong value, before any
    work."""

    @property
    def kept(self) -> Path:
        """Folder of docs/ that holds the files of results."""
        return DOCS / self.name


def run_study(study: Study[F, R], arguments: Sequence[str]) -> None:
    """Read the flags, measure, write the results and show them.

    Args:
        study: what is asked.
        arguments: the words after the study's name on the command line.

    Raises:
        InputError: a flag is wrong, tasks failed, or another process writes the folder.
    """
    prog = f"python -m lab {study.name}"
    flags = check_flags(tyro.cli(study.flags, prog=prog, args=arguments))
    at_least(1, jobs=flags.jobs)
    at_least(0, seed=flags.seed)
    study.check(flags)
    out = flags.out or RUNS / study.name
    with locked(out):
        content = study.measure(flags, Workshop(out, Backend(flags.jobs, flags.scheduler)))
        meta = provenance(flags.seed, simulated=True) | {"commit": commit()}
        meta["flags"] = flag_values(flags)
        name = f"{study.label(flags)}.json"
        write_results(out / name, Results(meta, content))
        texts = show_study(study, out, out)
    text = "\n\n".join(texts.values())
    write_bytes(out / f"{study.name}.md", f"{text}\n".encode())
    print(text)
    if flags.keep:
        write_bytes(study.kept / name, (out / name).read_bytes())
        keep_blocks(study)


def flag_values(flags: StudyFlags) -> dict[str, Any]:
    """Flags that decide the results, as JSON has them: all but where and how these are made."""
    left_out = ("jobs", "scheduler", "out", "keep")
    values = {name: value for name, value in asdict(flags).items() if name not in left_out}
    plain: dict[str, Any] = json.loads(json.dumps(values, default=str))
    return plain


def write_results(file: Path, results: Results[Any]) -> None:
    """Write what was measured, and what produced it, as strict JSON."""
    write_json(file, {"meta": results.meta, **asdict(results.content)})


def read_results(study: Study[F, R], file: Path) -> Results[R]:
    """Read a file of results.

    Raises:
        InputError: the file is missing or damaged, or holds the results of something else.
    """
    stored = read_json(file)
    content = checked(study.content, stored, str(file))
    checked(Making, stored.get("meta"), f"{file}, meta")
    return Results(stored["meta"], content)


def stored_results(study: Study[F, R], folder: Path) -> dict[str, Results[R]]:
    """Read all results of a study that a folder holds, by their label, in the labels' order."""
    return {file.stem: read_results(study, file) for file in sorted(folder.glob("*.json"))}


def show_study(study: Study[F, R], folder: Path, pictures: Path) -> dict[str, str]:
    """Make the tables of a study from its stored results, and write its pictures.

    Args:
        study: whose results are shown.
        folder: folder of the files of results.
        pictures: folder of the pictures.

    Returns:
        Markdown by the name of the page's block.
    """
    results = stored_results(study, folder)
    for name, figure in study.pictures(results).items():
        save_png(figure, pictures / name)
    return dict(study.blocks(results))


def keep_blocks(study: Study[F, R]) -> None:
    """Write the tables and pictures of the results that docs/ holds into its page and folder."""
    texts = show_study(study, study.kept, DOCS)
    if study.page is not None:
        for name in texts.keys() - study.printed_alone:
            replace_block(study.page, name, texts[name])
