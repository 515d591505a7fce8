"""Blocks of numbers in README.md and docs, each made of what a command left in docs/."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from lab.study import show_study
from lab.visibility.pilots import STUDY as PILOTS
from link.outside import read_json
from reports.films.delivery import delivery_block
from reports.render.tables import Table, percent, share_interval, summary_table
from reports.score.accuracy import read_scores
from reports.score.intervals import wilson
from reports.studies.information import information_table
from reports.studies.peers.page import OURS, best_readings, peers_block, read_peers
from reports.studies.prediction import prediction_blocks
from reports.visibility.frontier_tables import frontier_blocks

HARDER = {
    "kappa1": "κ 1, 45°",
    "60deg": "κ 3, 60°",
    "70deg": "κ 3, 70°",
    "drift": "drift 10 %",
    "shift": "shift 1 px (σ)",
    "jpeg": "JPEG 70",
}
"""Conditions beyond the paper, by their names in the ablation, and what the table calls them."""
DECODER_ROWS = {"oorc": "oorc", "full": "learned, untrained", "learned": "learned"}
"""Rows of the ablation that are decoders to use, and what the table calls them."""
FLOOR_ROWS = {"ideal_change": "ideal observer of the change alone", "ideal": "ideal observer"}
"""Observers that no decoder beats, and what the table calls them."""
Entries = dict[tuple[str, str], dict[str, Any]]
"""Entries of a stored ablation, by row and condition."""


def main_table(docs: Path) -> str:
    """Show the accuracy of every method in the paper's 36 cells, from docs/metrics.json."""
    scores, meta = read_scores(docs / "metrics.json")
    title = (
        f"Simulated: {scores['pair'].nunique()} camera–display pairs × 0°, 45° × κ 5, 3; "
        f"{scores['frames'].iloc[0]} frame pairs a cell, held-out pictures and channel draws, "
        f"seed {meta['seed']}."
    )
    return summary_table(scores, title).markdown()


def harder_table(docs: Path) -> str:
    """Show wrong bits beyond the paper's conditions, from ablation.json and ideal.json."""
    entries, ideal = _entries(docs / "ablation.json"), _entries(docs / "ideal.json")
    rows = [
        [name, *(percent(entries[row, key]["error"]) for key in HARDER)]
        for row, name in DECODER_ROWS.items()
    ]
    rows.append(["bits", *(f"{entries['oorc', key]['bits']:,}" for key in HARDER)])
    known = {row: [ideal.get((row, key)) for key in HARDER] for row in FLOOR_ROWS}
    for row, name in FLOOR_ROWS.items():
        rows.append([name, *(percent(e["error"]) if e else "–" for e in known[row])])
    rows.append(["their bits", *(f"{e['bits']:,}" if e else "–" for e in known["ideal"])])
    return Table(["bits wrong, %", *HARDER.values()], rows).markdown()


def measured_table(docs: Path) -> str:
    """Show single results with their number of bits, and the command that measured each."""
    answers = (_against_oorc, _left_out, _repeated, _other_systems, _wrong_messages)
    heads = ["question", "measured (simulated)", "by", "bits"]
    return Table(heads, [answer(docs) for answer in answers], left=3).markdown()


@dataclass(frozen=True)
class Block:
    """Text between two markers of a page."""

    page: Path
    """Page that holds the markers, relative to the checkout."""
    render: Callable[[Path], str]
    """Makes the text from the folder of stored results."""


README, RESULTS = Path("README.md"), Path("docs/results.md")
"""Pages that hold more than one study's numbers."""
BLOCKS = {
    "table": Block(README, main_table),
    "measured": Block(RESULTS, measured_table),
    "harder": Block(RESULTS, harder_table),
    "receiver": Block(Path("docs/receiver.md"), lambda docs: delivery_block(docs / "delivery")),
    "hidden_pilots": Block(
        Path("docs/hidden.md"), lambda docs: show_study(PILOTS, docs, docs)["hidden_pilots"]
    ),
    "peers": Block(Path("docs/peers.md"), lambda docs: peers_block(docs / "peers.json")),
    "information": Block(
        Path("docs/framing.md"), lambda docs: information_table(_read(docs / "information.json"))
    ),
}
"""Blocks by the name in their markers."""


def _frontier_block(name: str, docs: Path) -> str:
    return frontier_blocks(docs / "hidden.json")[name]


BLOCKS |= {
    name: Block(Path("docs/hidden.md"), partial(_frontier_block, name))
    for name in ("hidden_bits", "hidden_rates")
}


def _prediction_block(name: str, docs: Path) -> str:
    return prediction_blocks(docs / "prediction.json")[name]


BLOCKS |= {
    name: Block(Path("docs/prediction.md"), partial(_prediction_block, name))
    for name in (
        "prediction_sample", "prediction_errors", "prediction_order", "prediction_means",
        "prediction_fit", "prediction_worst", "prediction_cells",
    )
}  # fmt: skip


def _against_oorc(docs: Path) -> list[str]:
    content = _read(docs / "paper.json")
    entries = _entries(docs / "paper.json")
    ours, theirs = entries["learned", "paper"], entries["oorc", "paper"]
    paired = ours["against"]["oorc"]
    cells = [cell for cell in content["behind_oorc"] if cell["row"] == "learned"]
    result = (
        f"{ours['errors']:,} wrong bits to {theirs['errors']:,}: {percent(paired['ratio'], 1)} % "
        f"({share_interval(paired['ratio_low'], paired['ratio_high'], 1)}); behind in "
        f"{len(cells)} of 36 cells"
    )
    asked = "`learned` against `oorc` in the paper’s cells"
    return [asked, result, _command(content), f"{ours['bits']:,}"]


def _left_out(docs: Path) -> list[str]:
    content = _read(docs / "leave_one_out.json")
    pairs = content["pairs"]
    worst = min(pairs, key=lambda name: pairs[name]["difference"])
    paired = pairs[worst]
    result = (
        f"at worst {paired['difference']:+.2f} points ({paired['low']:+.2f} to "
        f"{paired['high']:+.2f}; {worst})"
    )
    asked = "trained on eight pairs and tested on the ninth, against trained on all nine"
    return [asked, result, _command(content), f"{paired['bits']:,} a pair"]


def _repeated(docs: Path) -> list[str]:
    content = _read(docs / "repeats.json")
    row = next(r for r in content["rows"] if (r["layout"], r["condition"]) == ("ratex", "kappa1"))
    bits = row["bits"]
    parts = [
        f"{percent(wrong / bits, 1)} % ({share_interval(*wilson(wrong, bits), 1)}) after {count}"
        for count, wrong in zip(content["captures"], row["wrong"]["one fit"], strict=True)
    ]
    asked = "κ 1, 45°: wrong bits after several captures of one frame pair, in one fit"
    return [asked, ", ".join(parts), _command(content), f"{bits:,}"]


def _other_systems(docs: Path) -> list[str]:
    content = _read(docs / "peers.json")
    rows = best_readings(read_peers(docs / "peers.json").rows)
    parts = []
    for name in dict.fromkeys(row.method for row in rows):
        usual = "κ 3" if name in OURS else "default"
        mine = {r.condition: r for r in rows if (r.method, r.strength) == (name, usual)}
        if mine:
            front, side = mine["0°"], mine["45°"]
            right = f"{percent(front.accuracy, 1)} and {percent(side.accuracy, 1)} %"
            parts.append(f"{name} {right} ({front.psnr:.1f} dB)")
    sizes = sorted({row.bits for row in rows if row.condition in ("0°", "45°")})
    asked = "other systems at their default strength: right bits filmed at 0° and 45° (PSNR)"
    return [asked, ", ".join(parts), _command(content), f"{sizes[0]:,} – {sizes[-1]:,}"]


def _wrong_messages(docs: Path) -> list[str]:
    content = _read(docs / "framing.json")
    parts = [
        f"{line['wrong']} of {line['decodes']:,} decodes (scores: {line['scores']})"
        for line in content["wrong"]
    ]
    return ["messages delivered that were not sent", "; ".join(parts), _command(content), ""]


def _read(file: Path) -> dict[str, Any]:
    content: dict[str, Any] = read_json(file)
    return content


def _entries(file: Path) -> Entries:
    return {(entry["row"], entry["condition"]): entry for entry in _read(file)["entries"]}


def _command(content: dict[str, Any]) -> str:
    return f"`{content['meta']['command']}`"
