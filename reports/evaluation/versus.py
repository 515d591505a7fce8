"""Two runs on the same captures: who is better, by how much, with paired tests."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from link.errors import InputError
from link.images import write_bytes
from reports.render.markup import Html, join, table, tag
from reports.render.page import page
from reports.render.sections.common import between, named, percent
from reports.run import Run, read_run
from reports.score.paired import MIN_FRAMES, Outcomes, Paired, compare, outcomes, tally

SAME = ("seed", "pictures", "captures", "ratex", "without", "set")
"""Settings that decide what was captured."""
PAGE = "compare.html"


@dataclass(frozen=True)
class Versus:
    """One method in both runs, over the frame pairs that both decoded."""

    where: str
    """"main comparison" or a sweep."""
    method: str
    errors_a: int
    errors_b: int
    paired: Paired
    """B against A: a positive difference is an improvement."""


def compare_runs(folder_a: Path, folder_b: Path) -> tuple[str, Path]:
    """Compare run B with run A; writes compare.html into B.

    Returns:
        a Markdown table, and the page.

    Raises:
        InputError: a run is not finished, or the two did not decode the same captures.
    """
    a, b = read_run(folder_a), read_run(folder_b)
    refuse_mismatch(a, b)
    found = match(a, b)
    notes = remarks(a, b, found)
    path = folder_b / PAGE
    write_bytes(path, _page(a, b, found, notes).encode())
    return _markdown(a, b, found, notes), path


def refuse_mismatch(a: Run, b: Run) -> None:
    """Raise an `InputError` naming the first setting by which the captures differ."""
    for key in SAME:
        left, right = (run.about["settings"].get(key) for run in (a, b))
        if left != right:
            raise InputError(
                f"--compare: {a.folder} has {key} {left} and {b.folder} has {right}; "
                "paired tests need runs on the same captures"
            )
    if a.simulated != b.simulated:
        raise InputError("--compare: one run is simulated and the other is not")


def match(a: Run, b: Run) -> list[Versus]:
    """Every method of both runs, in the main comparison and in each sweep that both have."""
    places: dict[str, tuple[list[dict[str, Any]], list[dict[str, Any]]]] = {
        "main comparison": (a.predictions, b.predictions)
    }
    for name in dict.fromkeys(point.sweep for point in a.sweeps):
        lines = tuple(_swept(run, name) for run in (a, b))
        if lines[1]:
            places[f"sweep: {a.sweep_texts[name]['title']}"] = (lines[0], lines[1])
    found = []
    for where, (left, right) in places.items():
        one, two = outcomes(left), outcomes(right)
        for method in (m for m in one if m in two):
            shared = [frame for frame in one[method] if frame in two[method]]
            if not shared:
                continue
            both: Outcomes = {
                "A": {frame: one[method][frame] for frame in shared},
                "B": {frame: two[method][frame] for frame in shared},
            }
            try:
                _, counts = tally(both, "B", "A")
            except InputError:
                raise InputError(
                    f"--compare: {method} was sent other bits in {a.folder} than in {b.folder}; "
                    "the runs are not of the same captures"
                ) from None
            if counts[:, 0].sum():
                result = compare(counts, np.random.default_rng(0))
                errors = counts.sum(axis=0)
                found.append(Versus(where, method, int(errors[2]), int(errors[1]), result))
    if not found:
        raise InputError(
            f"--compare: {a.folder} and {b.folder} share no method on a frame pair with known bits"
        )
    return found


def _swept(run: Run, name: str) -> list[dict[str, Any]]:
    """Predictions of a sweep; its value is part of what names a frame pair."""
    return [
        line | {"condition": point.value}
        for point in run.sweeps
        if point.sweep == name
        for line in point.predictions
    ]


def remarks(a: Run, b: Run, found: list[Versus]) -> list[str]:
    """What a reader must know: how much was shared, and what else differs."""
    notes = []
    for run, letter in ((a, "A"), (b, "B")):
        mine = set(run.methods) - {v.method for v in found}
        if mine:
            notes.append(f"Only in {letter}: {', '.join(sorted(mine))}.")
    frames = {run.folder: _frames(run) for run in (a, b)}
    if frames[a.folder] != frames[b.folder]:
        shared = len(frames[a.folder] & frames[b.folder])
        notes.append(
            f"A has {len(frames[a.folder])} frame pairs in its main comparison, B "
            f"{len(frames[b.folder])}; the {shared} that both have count."
        )
    if a.about["commit"] != b.about["commit"]:
        notes.append(
            f"Commits differ ({a.about['commit'] or 'unknown'}, {b.about['commit'] or 'unknown'}): "
            "if the channel was changed between them, the captures are not the same."
        )
    notes += [f"{key} differs: {x}, {y}." for key, x, y in _differences(a, b)]
    return notes


def _frames(run: Run) -> set[tuple[Any, ...]]:
    return {(p["pair"], p["view_deg"], p["kappa"], p["index"]) for p in run.predictions}


def _differences(a: Run, b: Run) -> list[tuple[str, Any, Any]]:
    left, right = a.about["settings"], b.about["settings"]
    shown = ("protocol", "run")
    found = [(k, left.get(k), right.get(k)) for k in shown if left.get(k) != right.get(k)]
    one, two = left.get("checkpoints", {}), right.get("checkpoints", {})
    for name in one:
        if name in two and one[name] != two[name]:
            found.append((f"checkpoint of {name}", one[name][:12], two[name][:12]))
    return found


def verdict(v: Versus) -> str:
    """In words, by the paired interval."""
    if v.paired.frames < MIN_FRAMES:
        return "too few frame pairs to tell"
    if v.paired.low > 0:
        return "B better"
    if v.paired.high < 0:
        return "A better"
    if v.paired.better + v.paired.worse == 0:
        return "equal, bit by bit"
    return "not told apart"


def _cells(v: Versus) -> list[str]:
    bits = v.paired.bits
    ratio = "–" if v.paired.ratio is None else f"{v.paired.ratio:.2f}"
    return [
        v.method,
        percent(1 - v.errors_a / bits),
        percent(1 - v.errors_b / bits),
        f"{v.paired.difference:+.2f}",
        between(v.paired),
        ratio,
        f"{v.paired.better} / {v.paired.worse}",
        f"{v.paired.p_bits:.2g}",
        f"{v.paired.frames:,}",
        f"{bits:,}",
        verdict(v),
    ]


HEADS = (
    "method", "A right %", "B right %", "B less A, points", "95 % interval", "errors of B / A",
    "bits only B / only A has right", "McNemar p", "frame pairs", "bits", "verdict",
)  # fmt: skip


def _markdown(a: Run, b: Run, found: list[Versus], notes: list[str]) -> str:
    blocks = [f"A: {a.folder}, B: {b.folder}; paired on identical captures"]
    for where in dict.fromkeys(v.where for v in found):
        rows = [f"| {' | '.join(_cells(v))} |" for v in found if v.where == where]
        head = f"| {' | '.join(HEADS)} |\n|---|{'---:|' * (len(HEADS) - 2)}---|"
        blocks.append("\n".join([where, "", head, *rows]))
    return "\n\n".join([*blocks, *notes])


def _page(a: Run, b: Run, found: list[Versus], notes: list[str]) -> str:
    lines = [
        tag("p", tag("b", letter), ": ", tag("code", run.about["meta"]["command"]), class_="muted")
        for letter, run in (("A", a), ("B", b))
    ]
    kind = "Simulated captures" if a.simulated else "Real captures"
    head = tag("header", tag("h1", "Two runs on the same captures"), *lines)
    parts: dict[str, tuple[str, Html]] = {}
    for number, where in enumerate(dict.fromkeys(v.where for v in found)):
        rows: list[list[object]] = []
        for v in (v for v in found if v.where == where):
            method, *rest = _cells(v)
            tint = {"B better": "good", "A better": "bad"}.get(rest[-1])
            rows.append([named(method), *rest[:-1], tag("span", rest[-1], class_=tint)])
        parts[f"part{number}"] = (where[0].upper() + where[1:], table(HEADS, rows))
    explained = tag(
        "p",
        f"{kind}. Frame pairs are matched by cell and number. Differences and ratios: bootstrap "
        "over frame pairs, 95 %. McNemar’s p takes bits for independent, which they are not.",
        class_="note",
    )
    parts["notes"] = ("Notes", join(explained, *(tag("p", note) for note in notes)))
    return page("Two runs compared", head, parts)
