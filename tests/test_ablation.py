"""The ablation: its rows and conditions, its arithmetic, and the command end to end."""

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import pytest
from conftest import Command

from data_gen.frame_pair import Source
from link.layout import Layout
from models.neural.checkpoint import save_checkpoint
from models.neural.decoder import FULL, DecoderConfig, PhiDecoder
from reports.engine.conditions import CONDITIONS, cells, source
from reports.score.metrics import score
from reports.score.paired import outcomes
from reports.studies import ablation
from reports.studies.ablation_page import measure, table
from reports.studies.variants import ADDED, REMOVED, ROWS, method_for

NOWHERE = Path("nowhere")
QUICK = ["--frames", "1", "--pairs", "canon-lg", "--jobs", "1"]
QUICK += ["--conditions", "kappa1", "jpeg", "--rows", "phi+register", "full-refine"]


def config_of(row: str) -> DecoderConfig:
    return dict(method_for(row, NOWHERE).options)["config"]


def differences(row: str, base: DecoderConfig) -> set[str]:
    config = config_of(row)
    names = [field.name for field in fields(DecoderConfig)]
    return {name for name in names if getattr(config, name) != getattr(base, name)}


def test_the_ends_are_the_twin_of_oorc_and_the_full_decoder() -> None:
    assert (config_of("phi"), config_of("full")) == (DecoderConfig(), FULL)
    assert method_for("oorc", NOWHERE).options == ()


def test_every_row_changes_what_it_names_and_no_more() -> None:
    for row, change in ADDED.items():
        assert differences(row, DecoderConfig()) == set(change), row
    for row, change in REMOVED.items():
        assert differences(row, FULL) == set(change), row
    assert len({repr(method_for(row, NOWHERE).options) for row in ROWS}) == len(ROWS)


def test_every_condition_films_its_cells(layout: Layout) -> None:
    base = Source(layout, without=("moire",))
    assert len(cells(CONDITIONS["paper"], ["canon-lg", "nikon-lg"])) == 8
    for name, condition in CONDITIONS.items():
        assert name.isascii()
        filmed = source(condition, base)
        assert (filmed.without, filmed.parameters) == (("moire",), condition.parameters)
        filmed.pair("canon-lg")


def lines(method: str, wrong: int) -> list[dict[str, Any]]:
    """Six frame pairs of four bits, of which ``wrong`` are decided wrong."""
    scores = [-1.0] * wrong + [1.0] * (4 - wrong)
    cell = {"method": method, "pair": "canon-lg", "view_deg": 0.0, "kappa": 3, "bits": [1] * 4}
    return [{**cell, "index": index, "scores": scores} for index in range(6)]


def test_an_entry_states_error_difference_and_multiple() -> None:
    predictions = lines("oorc", 3) + lines("full", 2) + lines("full-rows", 3) + lines("ideal", 1)
    entries = measure(score(predictions), outcomes(predictions), "jpeg", 0)
    page = table(entries, "full", ("full", "full-rows", "ideal")).splitlines()
    assert page[0] == "| row | jpeg, 24 bits |"
    assert page[2:] == [
        "| full | 50.00 ×2.00 |",
        "| full-rows | 75.00 (-25.00, -25.00 to -25.00) ×3.00 |",
        "| ideal | 25.00 (+25.00, +25.00 to +25.00) |",
    ]
    by_row = {entry.row: entry for entry in entries}
    assert set(by_row["oorc"].against) == {"full", "ideal"}
    assert by_row["full"].ci_low < 0.5 < by_row["full"].ci_high


def test_the_command_writes_tables_numbers_and_pictures(
    layout: Layout, tmp_path: Path, command: Command
) -> None:
    save_checkpoint(tmp_path / "run", PhiDecoder(layout, FULL), {})
    out = tmp_path / "out"
    done = command(ablation.main, *QUICK, "--run", tmp_path / "run", "--out", out)
    assert done.status == 0, done.stderr
    report = json.loads((out / "ablation.json").read_text())
    assert report["meta"]["simulated"] is True
    entries = {(e["row"], e["condition"]): e for e in report["entries"]}
    rows = ["oorc", "phi+register", "full", "full-refine", "learned"]
    conditions = {"kappa1": 59, "jpeg": 118}
    assert list(entries) == [(row, name) for name in conditions for row in rows]
    assert all(e["bits"] == conditions[name] for (_, name), e in entries.items())
    twin = entries["learned", "jpeg"]["against"]
    assert (twin["full"]["better"], twin["full"]["worse"]) == (0, 0)  # an untrained checkpoint
    assert set(twin) == {"oorc", "full"}
    written = (out / "ablation.md").read_text()
    assert "Simulated captures" in written and "seed 0" in written
    assert "| learned | jpeg |" in written and "| full-refine |" in written
    assert written.splitlines()[0] in done.stdout
    assert "full, all conditions" in (out / "reliability.md").read_text()
    for name in ("ablation.png", "reliability.png"):
        assert (out / name).stat().st_size > 5000


@pytest.mark.parametrize(
    ("flags", "message"),
    [
        ("--conditions rain", "--conditions 'rain'; choose one of: paper, kappa1, 60deg, 70deg"),
        ("--rows phi+magic", "--rows 'phi+magic'; choose one of: oorc, phi, phi+drift"),
        ("--pairs leica-lg", "--pairs 'leica-lg'; choose one of: "),
        ("--pairs canon-lg canon-lg", "--pairs: name at least one, and none twice"),
        ("--frames 0", "--frames"),
        ("--seed -1", "--seed"),
        ("--run nowhere", "--run: nowhere"),
    ],
)
def test_wrong_flags_are_refused(
    flags: str, message: str, tmp_path: Path, command: Command
) -> None:
    done = command(ablation.main, *flags.split(), "--out", tmp_path / "out")
    assert done.status == 2
    assert message in done.stderr and done.stderr.count("\n") == 1
    assert not (tmp_path / "out").exists()
