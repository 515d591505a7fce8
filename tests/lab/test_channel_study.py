"""The study of the channel: what each effect costs."""

from data_gen.effects import EFFECTS
from data_gen.frame_pair import Source
from lab.simulation.sensitivity import ALL_EFFECTS, effect_conditions, sensitivity_tables
from link.layout import Layout
from reports.engine.records import to_records


def test_the_effects_are_switched_off_one_at_a_time(layout: Layout) -> None:
    whole, *others = effect_conditions(Source(layout), 2)
    assert whole.source.without == () and whole.name == ALL_EFFECTS
    assert {condition.source.without for condition in others} == {
        (effect,) for effect in set(EFFECTS) - {"perspective", "transfer"}
    }
    assert {condition.cells for condition in others} == {whole.cells}


def test_a_sensitivity_table_pairs_frame_pairs() -> None:
    def predicted(condition: str, wrong: list[int]) -> list[dict[str, object]]:
        return [
            {
                "condition": condition, "method": "oorc", "pair": "canon-lg", "view_deg": 45.0,
                "kappa": 3, "picture": None, "index": index, "bits": [1] * 10,
                "scores": [-1.0] * count + [1.0] * (10 - count),
            }
            for index, count in enumerate(wrong)
        ]  # fmt: skip

    lines = predicted(ALL_EFFECTS, [1, 5, 9]) + predicted("drift", [0, 4, 8])
    (table,) = sensitivity_tables(to_records(lines + predicted("blur", [1, 5, 6])))
    assert table.heads == ["switched off", "oorc"]
    assert [row[1] for row in table.rows] == ["50.0", "+10.0 ±0.0", "+10.0 ±19.6"]
    assert "45°" in table.title and "3 frame pairs" in table.title
