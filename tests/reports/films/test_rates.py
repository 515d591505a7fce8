"""The table of how fast presets deliver."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from link.errors import InputError
from link.presets import PRESETS
from reports.films.delivery import check_delivery
from reports.films.rates import SETTINGS, RatesConfig, contrast_of, rates_table, stored_series


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_can_be_run(name: str) -> None:
    config = RatesConfig().series(name, 45.0)
    check_delivery(config)
    assert config.layout == PRESETS[config.preset].layout
    assert config.fps >= 2 * config.state_hz
    assert config.n_bytes == {"paper": 100, "robust": 2000}.get(name, 20_000)


def test_hidden_is_below_the_threshold_and_paper_is_not() -> None:
    hidden, paper = (
        contrast_of(config.preset, config.state_hz, config.kappa)
        for config in (SETTINGS["hidden"], SETTINGS["paper"])
    )
    assert hidden <= 1.0 < paper


def test_rates_are_those_of_the_runs(tmp_path: Path) -> None:
    def run(seconds: float, delivered: bool) -> dict[str, object]:
        return {
            "seconds": seconds, "delivered": delivered, "wrong": False, "bits": 100,
            "bits_wrong": 5,
        }  # fmt: skip

    by_view = {45.0: [run(9.0, False)], 0.0: [run(2.0, True), run(4.0, True)]}
    for view, runs in by_view.items():
        chosen = RatesConfig(out=tmp_path).series("fast", view)
        setup = {key: value for key, value in asdict(chosen).items() if key not in ("out", "jobs")}
        chosen.out.mkdir(parents=True)
        content = json.dumps({"config": setup, "summary": [{"bound_seconds": 1.25}], "runs": runs})
        (chosen.out / f"{chosen.name}.json").write_text(content)
    table = rates_table(stored_series(tmp_path))
    cells, lost = (dict(zip(table.heads, row, strict=True)) for row in table.rows)
    assert cells["delivered"] == "2 of 2"
    assert cells["goodput, kbit/s, median"] == "60"  # of 80 and 40
    assert cells["least"] == "40"
    assert cells["bound, s"] == "1.2"
    assert cells["bits wrong %"] == "5.00"
    assert lost["view"] == "45°"
    assert (lost["delivered"], lost["least"], lost["seconds, median"]) == ("0 of 1", "–", "–")


def test_an_unknown_setting_lists_the_others() -> None:
    with pytest.raises(InputError, match="slow camera"):
        RatesConfig().series("quick", 0.0)
