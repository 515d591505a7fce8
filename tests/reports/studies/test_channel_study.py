"""The report on the channel: disjoint times of its stages, and what each effect costs."""

import contextlib
import sys
from functools import partial
from pathlib import Path
from time import perf_counter

import pytest
from conftest import Command

from data_gen.effects import EFFECTS
from data_gen.frame_pair import FramePair, Source
from link.layout import Layout
from reports.engine.records import to_records
from reports.studies import channel, channel_time
from reports.studies.channel_time import REST, time_stages
from reports.studies.sensitivity import ALL_EFFECTS, effect_conditions, sensitivity_tables


class Ticks:
    """A clock that runs only where a function says so."""

    def __init__(self) -> None:
        self.now = 0.0

    def read(self) -> float:
        return self.now


def test_times_of_stages_are_disjoint_and_add_up_to_the_whole() -> None:
    clock = Ticks()

    class Camera:
        def expose(self) -> None:
            clock.now += 4

    class Shot:
        def expose(self) -> None:
            """Bears the name of another stage, calls it, and itself again."""
            clock.now += 1
            Camera().expose()
            clock.now += 2

    def outside() -> None:
        clock.now += 8
        Shot().expose()
        clock.now += 16
        Camera().expose()
        Shot().expose()

    stages = {"shot": (Shot.expose,), "camera": (Camera.expose,), "unused": (lines_of,)}
    times = time_stages(outside, stages, clock.read)
    assert times == {"shot": 6, "camera": 12, "unused": 0, REST: 24}
    assert sum(times.values()) == clock.now


def lines_of(page: Path) -> list[str]:
    return page.read_text().splitlines()


def test_a_stage_that_raises_or_calls_itself_keeps_its_time() -> None:
    clock = Ticks()

    def stage(depth: int) -> None:
        clock.now += 1
        if depth == 0:
            raise ValueError
        stage(depth - 1)

    def outside() -> None:
        with contextlib.suppress(ValueError):
            stage(2)
        clock.now += 10

    assert time_stages(outside, {"stage": (stage,)}, clock.read) == {"stage": 3, REST: 10}
    with pytest.raises(ValueError):
        time_stages(lambda: stage(0), {"stage": (stage,)}, clock.read)
    assert sys.getprofile() is None


def test_times_of_the_channel_are_positive_and_fill_the_whole(layout: Layout) -> None:
    pair = FramePair(Source(layout), channel_time.TIMED_CELL, 0)
    _ = pair.displayed
    start = perf_counter()
    times = time_stages(partial(getattr, pair, "captured"), channel_time.CHANNEL_STAGES)
    elapsed = perf_counter() - start
    assert set(times) == {*channel_time.CHANNEL_STAGES, REST}
    assert min(times.values()) > 0, times  # every function of every stage is still called
    assert sum(times.values()) <= elapsed
    assert times[REST] < 0.2 * sum(times.values())


def test_the_time_of_the_channel_goes_into_its_block(command: Command, tmp_path: Path) -> None:
    page = tmp_path / "channel.md"
    page.write_text("before\n<!-- time -->\nold\n<!-- /time -->\nafter\n")
    done = command(channel.main, "--only", "time", "--timed", 3, "--out", page)
    assert done.status == 0, done.stderr
    written = lines_of(page)
    assert written[0] == "before" and written[-1] == "after" and "old" not in written
    rows = [line.strip("| ").split(" | ") for line in written if line.startswith("| ")][1:]
    assert [row[0] for row in rows] == [*channel_time.CHANNEL_STAGES, REST, "whole"]
    means = [float(row[1]) for row in rows]
    assert min(means) >= 0
    assert sum(means[:-1]) == pytest.approx(means[-1], abs=0.05 * len(means))
    assert "pairs a second on one core" in page.read_text()
    assert [file.name for file in tmp_path.iterdir()] == ["channel.md"]


@pytest.mark.parametrize("only", [["weather"], ["time", "time"]])
def test_unknown_parts_of_the_channel_are_refused(
    only: list[str], command: Command, tmp_path: Path
) -> None:
    assert command(channel.main, "--only", *only, "--out", tmp_path / "page.md").status == 2


@pytest.mark.parametrize("content", [None, "empty", "<!-- time -->\nno end\n"])
def test_a_page_without_blocks_is_refused_before_any_work(
    content: str | None, command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(channel, "time_report", None)  # calling it would raise
    page = tmp_path / "page.md"
    if content is not None:
        page.write_text(content)
    done = command(channel.main, "--only", "time", "--out", page)
    assert done.status == 2 and done.stderr.startswith("error: --out: ")


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
