"""The ablation: its rows and conditions, its arithmetic, and the command end to end."""

import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT, Command

from data_gen.frame_pair import Cell, Source
from lab import __main__ as lab
from lab.ablation import STUDY
from lab.study import Results, read_results, write_results
from link.layout import Layout
from models.phi.checkpoint import save_checkpoint
from models.phi.config import FULL, DecoderConfig
from models.phi.decoder import PhiDecoder
from reports.ablation.page import ablation_figure, ablation_tables
from reports.ablation.results import Ablation, compare_rows
from reports.ablation.switches import ADDED, REMOVED, ROWS, row_method
from reports.engine.conditions import SETTINGS, named_condition
from reports.engine.records import to_records

NOWHERE = Path("nowhere")
QUICK = ["--frames", "1", "--pairs", "canon-lg", "--jobs", "1"]
QUICK += ["--conditions", "kappa1", "jpeg", "--rows", "phi+register", "full-refine"]


def config_of(row: str) -> DecoderConfig:
    return dict(row_method(row, NOWHERE).options)["config"]


def differences(row: str, base: DecoderConfig) -> set[str]:
    config = config_of(row)
    names = [field.name for field in fields(DecoderConfig)]
    return {name for name in names if getattr(config, name) != getattr(base, name)}


def test_the_ends_are_the_twin_of_oorc_and_the_full_decoder() -> None:
    assert (config_of("phi"), config_of("full")) == (DecoderConfig(), FULL)
    assert row_method("oorc", NOWHERE).options == ()


def test_every_row_changes_what_it_names_and_no_more() -> None:
    for row, change in ADDED.items():
        assert differences(row, DecoderConfig()) == set(change), row
    for row, change in REMOVED.items():
        assert differences(row, FULL) == set(change), row
    assert len({repr(row_method(row, NOWHERE).options) for row in ROWS}) == len(ROWS)


def test_every_condition_films_its_cells(layout: Layout) -> None:
    base = Source(layout, without=("moire",))
    assert len(named_condition("paper", base, ["canon-lg", "nikon-lg"], 1).cells) == 8
    for name, setting in SETTINGS.items():
        assert name.isascii()
        condition = named_condition(name, base, ["canon-lg"], 2)
        assert (condition.name, condition.frames) == (name, 2)
        views, kappas = setting.views, setting.kappas
        assert set(condition.cells) == {Cell("canon-lg", v, k) for v in views for k in kappas}
        filmed = condition.source
        assert (filmed.without, filmed.parameters) == (("moire",), setting.parameters)
        filmed.pair("canon-lg")


def lines(method: str, wrong: int, condition: str = "jpeg") -> list[dict[str, Any]]:
    """Six frame pairs of four bits, of which ``wrong`` are decided wrong."""
    scores = [-1.0] * wrong + [1.0] * (4 - wrong)
    cell = {"pair": "canon-lg", "view_deg": 0.0, "kappa": 3, "bits": [1] * 4, "picture": None}
    line = {"condition": condition, "method": method, **cell, "scores": scores}
    return [{**line, "index": index} for index in range(6)]


def stored_ablation(folder: Path, *predictions: list[dict[str, Any]]) -> Ablation:
    """What ablation.json would hold, read back from strict JSON."""
    records = to_records([line for mine in predictions for line in mine])
    meta = {"seed": 0, "simulated": True, "command": "python"}
    file = folder / "ablation.json"
    write_results(file, Results(meta, Ablation(compare_rows(records, 0))))
    return read_results(STUDY, file).content


def test_an_entry_states_error_and_difference(tmp_path: Path) -> None:
    stored = stored_ablation(
        tmp_path, lines("oorc", 3), lines("full", 2), lines("full-rows", 3), lines("learned", 1)
    )
    _, removed = ablation_tables(stored)
    page = removed.markdown().splitlines()
    assert page[0] == "Removed from the full decoder"
    assert page[2] == "| row, against full | jpeg, 24 bits |"
    assert page[4:] == [
        "| full | 50.00 |",
        "| full-rows | 75.00 (-25.00, -25.00 to -25.00) |",
        "| learned | 25.00 (+25.00, +25.00 to +25.00) |",
    ]
    assert [row[1].tint for row in removed.cells] == ["", "bad", "good"]
    by_row = {entry.row: entry for entry in stored.entries}
    assert set(by_row["oorc"].against) == {"full"}
    assert by_row["full"].ci_low < 0.5 < by_row["full"].ci_high
    written = json.loads((tmp_path / "ablation.json").read_text())["entries"]
    assert [asdict(entry) for entry in stored.entries] == written


def test_cells_behind_oorc_are_counted(tmp_path: Path) -> None:
    stored_ablation(
        tmp_path,
        lines("oorc", 1),
        lines("full", 2),
        lines("oorc", 2, "shift"),
        lines("full", 1, "shift"),
    )
    entries = json.loads((tmp_path / "ablation.json").read_text())["entries"]
    behind = {(each["row"], each["condition"]): each["cells_behind"] for each in entries}
    assert behind == {
        ("oorc", "jpeg"): 0, ("full", "jpeg"): 1, ("oorc", "shift"): 0, ("full", "shift"): 0,
    }  # fmt: skip


@pytest.mark.slow
def test_the_shipped_ablation_makes_tables_and_a_figure() -> None:
    results = read_results(STUDY, ROOT / "docs/ablation/ablation.json")
    stored = results.content
    added, removed = ablation_tables(stored)
    rows = {entry.row for entry in stored.entries}
    conditions = {entry.condition for entry in stored.entries}
    assert {row[0] for row in [*added.rows, *removed.rows]} == rows
    assert len(added.heads) == len(removed.heads) == 1 + len(conditions)
    figure = ablation_figure(stored)
    assert len(figure.axes) == 2 * len(conditions)
    dots = {text.get_text() for axes in figure.axes for text in axes.get_yticklabels()}
    assert dots == rows - {"oorc"}


@pytest.mark.slow
def test_the_command_writes_tables_numbers_and_pictures(
    layout: Layout, tmp_path: Path, command: Command
) -> None:
    decoder = PhiDecoder(layout, FULL)
    save_checkpoint(tmp_path / "run", decoder, decoder.to_config())
    out = tmp_path / "out"
    done = command(lab.main, "ablation", *QUICK, "--run", tmp_path / "run", "--out", out)
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
    assert "| learned |" in written and "| full-refine |" in written
    assert written.splitlines()[0] in done.stdout
    assert "Expected calibration error" in written
    for name in ("ablation.png", "reliability.png"):
        assert (out / name).stat().st_size > 5000
