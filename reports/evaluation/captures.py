"""The comparison of methods on a folder of captures, the user's own or simulated ones."""

from collections.abc import Sequence
from pathlib import Path

from link.captures import MANIFEST, read_manifest
from reports.captured.door import FILMS
from reports.captured.evidence import film_evidence
from reports.engine.backends import Backend
from reports.engine.digest import file_digest
from reports.engine.methods import Method
from reports.engine.predict import decode_captures
from reports.engine.provenance import provenance
from reports.evaluation.evidence import Stopwatch, captured_pictures
from reports.render.tables import information_table, summary_table
from reports.run import PREDICTIONS, RunFolder
from reports.score.accuracy import score


def evaluate_folder(
    captures: Path,
    methods: Sequence[Method],
    folder: RunFolder,
    seed: int,
    backend: Backend,
    html: bool,
    notes: Sequence[str] = (),
) -> None:
    """Decode every frame pair of a manifest, score what is known, print and write the results.

    Args:
        captures: folder with a manifest.
        methods: methods; one that does not suit a frame pair is left out of it, and a line says so.
        folder: folder of the run; its settings are written already.
        seed: seed of the paired comparisons' resamples.
        backend: where captures are decoded.
        html: whether to write the pictures that report.html shows beside the predictions.
        notes: what a reader must know of how the captures were recorded.
    """
    clock = Stopwatch()
    with clock.time("decoding"):
        file = folder.path / PREDICTIONS
        records, left_out = decode_captures(captures, methods, file, backend)
    notes = [*notes, *left_out]
    print(*notes, sep="\n")
    entries = read_manifest(captures)
    simulated = all(bool(entry.meta.get("simulated")) for entry in entries)
    meta = provenance(seed, simulated)
    kind = "simulated captures" if simulated else "recorded captures"
    tables = [summary_table(score(records), f"All cells ({kind})").markdown()]
    if any(entry.is_window for entry in entries):
        tables.append(information_table(records).markdown())
    folder.write_comparison(records, meta, "\n\n".join(tables))
    print(*tables, f"written: {folder.path}/predictions.jsonl, metrics.json, tables.md", sep="\n\n")
    if any("time_s" in entry.meta for entry in entries):
        with clock.time("counting"):
            folder.write(FILMS, film_evidence(captures, records, folder.path, html))
    if html:
        with clock.time("pictures"):
            captured_pictures(folder, captures, records)
    manifest = f"manifest {file_digest([captures / MANIFEST])[:16]}"
    folder.finish(meta, clock.seconds, notes, captures=manifest)
