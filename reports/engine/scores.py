"""A run's folder, first part: refuse another run's, and write and print its scores."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from link.errors import InputError
from link.images import make_folder, write_bytes
from reports.render.tables import paper_tables, summary_table
from reports.score.metrics import score, write_metrics

CONFIG = "config.json"


def refuse_other_run(out: Path, settings: bytes) -> None:
    """Refuse a folder that holds the results of other settings."""
    make_folder(out)
    file = out / CONFIG
    if file.is_file() and file.read_bytes() != settings:
        raise InputError(f"--out: {out} holds a run with other settings; choose another folder")


def write_scores(
    out: Path,
    predictions: Sequence[dict[str, Any]],
    meta: Mapping[str, Any],
    title: str,
    beside_paper: bool,
) -> None:
    """Write metrics.json and tables.md, and print the tables.

    Args:
        out: folder of the run.
        predictions: lines of predictions.jsonl.
        meta: as of `metrics.provenance`.
        title: of the summary.
        beside_paper: print the paper's tables too.
    """
    rows = score(predictions)
    write_metrics(out / "metrics.json", rows, dict(meta))
    tables = summary_table(rows, title)
    if beside_paper:
        tables = f"{paper_tables(rows)}\n\n{tables}"
    write_bytes(out / "tables.md", f"{tables}\n".encode())
    print(f"{tables}\n\nwritten: {out}/predictions.jsonl, metrics.json, tables.md")
