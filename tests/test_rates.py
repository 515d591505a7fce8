"""The table of how fast presets deliver."""

import pytest

from link.errors import InputError
from link.presets import PRESETS
from reports.films.delivery import check_delivery
from reports.films.rates import SETTINGS, RatesConfig, contrast_of, rates_table


@pytest.mark.parametrize("name", SETTINGS)
def test_settings_can_be_run(name: str) -> None:
    config = RatesConfig().series(name)
    check_delivery(config)
    assert config.layout == PRESETS[config.preset].layout
    assert config.fps >= 2 * config.state_hz
    assert config.n_bytes == {"paper": 100, "robust": 2000}.get(name, 20_000)


def test_hidden_is_below_the_threshold_and_paper_is_not() -> None:
    hidden, paper = (contrast_of(RatesConfig().series(name)) for name in ("hidden", "paper"))
    assert hidden <= 1.0 < paper


def test_rates_are_those_of_the_runs() -> None:
    def run(view: float, seconds: float, delivered: bool) -> dict[str, object]:
        return {
            "view_deg": view, "seconds": seconds, "delivered": delivered, "wrong": False,
            "bits": 100, "bits_wrong": 5,
        }  # fmt: skip

    config = {"preset": "fast", "kappa": 3, "state_hz": 30.0, "fps": 60.0, "n_bytes": 20_000}
    runs = [run(0.0, 2.0, True), run(0.0, 4.0, True), run(45.0, 9.0, False)]
    table = rates_table({"fast": {"config": config, "runs": runs}}, {"fast": 2.5})
    cells = dict(zip(table.heads, table.rows[0], strict=True))
    assert cells["delivered"] == "2 of 2"
    assert cells["goodput, kbit/s, median"] == "60"  # of 80 and 40
    assert cells["least"] == "40"
    assert cells["bits wrong %"] == "5.00"
    lost = dict(zip(table.heads, table.rows[1], strict=True))
    assert (lost["delivered"], lost["least"], lost["seconds, median"]) == ("0 of 1", "–", "–")


def test_an_unknown_setting_lists_the_others() -> None:
    with pytest.raises(InputError, match="slow camera"):
        RatesConfig().series("quick")
