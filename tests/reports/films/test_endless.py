"""Long streams: memory and the time of a frame do not grow, and nothing comes of noise."""

from pathlib import Path

import pytest
from conftest import Command

from reports.films import endless
from reports.films.endless import (
    BLOCKS,
    StreamBlock,
    false_starts,
    growth_mib,
    loops_until_changed,
    measure_stream,
)


def test_growth_is_measured_after_the_buffers_are_full() -> None:
    def block(number: int, memory: float) -> StreamBlock:
        return StreamBlock(number, 1, 1, memory, 0, 0)

    filling = [block(n, min(n, 20)) for n in range(100)]
    assert growth_mib(filling) == 0
    assert growth_mib([block(n, n) for n in range(100)]) == 60


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stream", "frames", "messages"), [("noise", 400, 0), ("still", 600, 0), ("film", 900, 1)]
)
def test_memory_and_time_are_bounded(stream: str, frames: int, messages: int) -> None:
    blocks = measure_stream(stream, frames, seed=0)
    assert len(blocks) == BLOCKS
    assert blocks[-1].last == frames
    # 256 rectified frames, which wait for a clock, are 150 MiB
    assert blocks[-1].memory_mib - blocks[0].memory_mib < 220
    assert blocks[-1].messages == messages
    assert blocks[-1].attempts <= frames / 4
    if stream == "noise":  # elsewhere a buffer fills, as far as the line above allows
        assert growth_mib(blocks) < 25


def test_a_message_that_goes_on_is_no_change_and_another_one_is() -> None:
    found = false_starts(0.05, noisy_loops=False, frames=400, seed=0)
    assert found.again == 0
    assert found.starts < 20
    assert found.collecting < 0.03
    assert max(loops_until_changed(0.05, changes=2, seed=0)) < 2


QUICK = ["--frames", 100, "--streams", "noise", "--scores", 50, "--changes", 1]


@pytest.mark.slow
def test_command_measures_and_draws(tmp_path: Path, command: Command) -> None:
    done = command(endless.main, *QUICK, "--out", tmp_path)
    assert done.status == 0, done.stderr
    assert "noise" in done.stdout
    assert {file.name for file in tmp_path.iterdir()} == {"endless.json", "endless.png"}
    assert command(endless.main, "--frames", 10).status == 2
    assert "unknown stream 'x'" in command(endless.main, "--streams", "x").stderr
