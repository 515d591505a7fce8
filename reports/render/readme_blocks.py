"""README's blocks of numbers, each from what a command left in docs/."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from reports.render.tables import summary_table
from reports.score.metrics import read_metrics, wilson
from reports.studies.delivery import readme_block as delivery_block
from reports.studies.peers.page import OURS, PeerRow, best_readings

HARDER = {
    "kappa1": "κ 1, 45°",
    "60deg": "κ 3, 60°",
    "70deg": "κ 3, 70°",
    "drift": "drift 10 %",
    "shift": "shift 1 px (σ)",
    "jpeg": "JPEG 70",
}
ROWS = {"oorc": "oorc", "full": "learned, untrained", "learned": "learned"}
FLOORS = {"ideal_change": "ideal observer of the change alone", "ideal": "ideal observer"}
Entries = dict[tuple[str, str], dict[str, Any]]


def main_table(docs: Path) -> str:
    """The paper's 36 cells: docs/metrics.json."""
    rows, meta = read_metrics(docs / "metrics.json")
    frames = {row.frames for row in rows}
    title = (
        f"Simulated: {len({row.pair for row in rows})} camera–display pairs × 0°, 45° × κ 5, 3; "
        f"{frames.pop()} frame pairs a cell, held-out pictures and channel draws, "
        f"seed {meta['seed']}."
    )
    return summary_table(rows, title)


def harder(docs: Path) -> str:
    """Conditions beyond the paper: docs/ablation.json, and the floor from docs/ideal.json."""
    entries, ideal = _entries(docs / "ablation.json"), _entries(docs / "ideal.json")
    lines = [f"| bits wrong, % | {' | '.join(HARDER.values())} |", "|---|" + "---:|" * len(HARDER)]
    for row, name in ROWS.items():
        lines.append(_row(name, [_error(entries[row, c]) for c in HARDER]))
    lines.append(_row("bits", [f"{entries['oorc', c]['bits']:,}" for c in HARDER]))
    floors = {row: [ideal.get((row, c)) for c in HARDER] for row in FLOORS}
    for row, name in FLOORS.items():
        lines.append(_row(name, [_error(e) if e else "–" for e in floors[row]]))
    lines.append(_row("their bits", [f"{e['bits']:,}" if e else "–" for e in floors["ideal"]]))
    return "\n".join(lines)


def measured(docs: Path) -> str:
    """Single results with their sample, and the command of each."""
    lines = ["| question | measured (simulated) | bits | by |", "|---|---|---:|---|"]
    for ask in (_against_oorc, _left_out, _repeated, _other_systems, _wrong_messages):
        lines.append(ask(docs))
    return "\n".join(lines)


BLOCKS: dict[str, Callable[[Path], str]] = {
    "table": main_table,
    "harder": harder,
    "measured": measured,
    "receiver": lambda docs: delivery_block(docs / "delivery"),
}
"""By the marker in README.md."""


def _against_oorc(docs: Path) -> str:
    content = _read(docs / "paper.json")
    entries = _entries(docs / "paper.json")
    ours, theirs = entries["learned", "paper"], entries["oorc", "paper"]
    paired = ours["against"]["oorc"]
    cells = [cell for cell in content["behind_oorc"] if cell["row"] == "learned"]
    result = (
        f"{ours['errors']:,} wrong bits to {theirs['errors']:,}: {100 * paired['ratio']:.1f} % "
        f"({100 * paired['ratio_low']:.1f} – {100 * paired['ratio_high']:.1f}); behind in "
        f"{len(cells)} of 36 cells"
    )
    asked = "`learned` against `oorc` in the paper’s cells"
    return _row(asked, [result, f"{ours['bits']:,}", _command(content)])


def _left_out(docs: Path) -> str:
    content = _read(docs / "leave_one_out.json")
    pairs = content["pairs"]
    worst = min(pairs, key=lambda name: pairs[name]["difference"])
    paired = pairs[worst]
    result = (
        f"at worst {paired['difference']:+.2f} points ({paired['low']:+.2f} to "
        f"{paired['high']:+.2f}; {worst})"
    )
    asked = "trained on eight pairs and tested on the ninth, against trained on all nine"
    return _row(asked, [result, f"{paired['bits']:,} a pair", _command(content)])


def _repeated(docs: Path) -> str:
    content = _read(docs / "repeats.json")
    bits, *errors = content["errors"]["kappa1"]
    parts = []
    for count, wrong in zip(content["captures"], errors, strict=True):
        low, high = wilson(wrong, bits)
        shown = f"{100 * wrong / bits:.1f} % ({100 * low:.1f} – {100 * high:.1f})"
        parts.append(f"{shown} after {count}")
    asked = "κ 1, 45°: wrong bits after several captures of one frame pair"
    return _row(asked, [", ".join(parts), f"{bits:,}", _command(content)])


def _other_systems(docs: Path) -> str:
    content = _read(docs / "peers.json")
    rows = best_readings([PeerRow(**row) for row in content["rows"]])
    parts = []
    for name in dict.fromkeys(row.method for row in rows):
        usual = "κ 3" if name in OURS else "default"
        mine = {r.condition: r for r in rows if (r.method, r.strength) == (name, usual)}
        if mine:
            front, side = mine["0°"], mine["45°"]
            right = f"{100 * front.accuracy:.1f} and {100 * side.accuracy:.1f} %"
            parts.append(f"{name} {right} ({front.psnr:.1f} dB)")
    sizes = sorted({row.bits for row in rows if row.condition in ("0°", "45°")})
    asked = "other systems at their default strength: right bits filmed at 0° and 45° (PSNR)"
    return _row(asked, [", ".join(parts), f"{sizes[0]:,} – {sizes[-1]:,}", _command(content)])


def _wrong_messages(docs: Path) -> str:
    content = _read(docs / "framing.json")
    parts = [
        f"{line['wrong']} of {line['decodes']:,} decodes (scores: {line['scores']})"
        for line in content["wrong"]
    ]
    return _row("messages delivered that were not sent", ["; ".join(parts), "", _command(content)])


def _read(file: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(file.read_text())
    return content


def _entries(file: Path) -> Entries:
    return {(entry["row"], entry["condition"]): entry for entry in _read(file)["entries"]}


def _row(name: str, cells: list[str]) -> str:
    return f"| {name} | {' | '.join(cells)} |"


def _error(entry: dict[str, Any]) -> str:
    return f"{100 * entry['error']:.2f}"


def _command(content: dict[str, Any]) -> str:
    return f"`{content['meta']['command']}`"
