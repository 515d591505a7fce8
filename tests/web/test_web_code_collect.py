"""The page's collector returns the same messages at the same frames as Python's."""

from collections.abc import Iterable

import numpy as np
import pytest
from conftest import cases, exhaustive
from port import Port, same
from scores import noisy, shown
from tolerances import FLOAT32, FLOAT32_SUM

from link.code.collect import make_collector
from link.code.framing import encode
from link.types import Array


def compare(port: Port, rows: Array, starts: Iterable[int] = (), counts: Iterable[int] = ()) -> int:
    """Compare what the page's collector and Python's say to each row.

    Args:
        port: what calls the page's collector.
        rows: (frames, n_bits) scores.
        starts: rows before which a run starts.
        counts: of all frames; by default those from 1000 on.

    Returns:
        how many messages came.
    """
    collector, rows = make_collector(rows.shape[1]), rows.astype(np.float32)
    ported = port("link/code/collectFine.js").FineCollector(rows.shape[1])
    counts, starts = list(counts) or range(1000, 1000 + len(rows)), set(starts)
    messages = 0
    for at, (row, count) in enumerate(zip(rows, counts, strict=True)):
        if at in starts:
            collector.start_run()
            ported.startRun()
        known, found = collector.add(row, count), ported.add(row, count)
        step = [ported.progress, ported.attempts]
        same(step, [collector.progress, collector.attempts], FLOAT32_SUM)
        assert (found is None) == (known is None), f"message at row {at}"
        if known is not None:
            messages += 1
            assert bytes(found.data) == known.data
            numbers = [known.frames, known.seen, known.agreement, known.changed, known.signed]
            same(
                [found.frames, found.seen, found.agreement, found.changed, found.signed],
                numbers,
                FLOAT32,
            )
    return messages


def test_wrong_scores_are_no_message(port: Port) -> None:
    rng = np.random.default_rng(3)
    noise = rng.normal(0, 6, (20, 730)).astype(np.float32)
    mixed = encode(bytes(300), 730)
    mixed[:, 365:] = encode(bytes(299) + b"\1", 730)[:, 365:]
    for rows in (noise, shown(mixed, rng, 16)):
        assert compare(port, rows) == 0


@cases((730, 0.05), exhaustive(2918, 0.1))
def test_a_fine_loop_is_joined_anywhere(n_bits: int, ber: float, port: Port) -> None:
    rng = np.random.default_rng(4)
    bits = encode(rng.bytes(n_bits // 8), n_bits)
    for start in range(0, len(bits), 3):
        assert compare(port, shown(bits, rng, 13, start, ber, 0.2)) == 1


def test_a_fine_loop_of_which_little_can_be_read(port: Port) -> None:
    rng = np.random.default_rng(5)
    bits = encode(rng.bytes(100), 2765)[np.arange(20, 75) % 32]
    scores = 0.2 * bits - 0.1 + rng.normal(0, np.sqrt(0.2), bits.shape)
    assert compare(port, scores) == 1


def test_fine_messages_that_change(port: Port) -> None:
    rng = np.random.default_rng(5)
    texts = [rng.bytes(340), rng.bytes(340), rng.bytes(100)]
    loops = [encode(texts[number], 730, signed=number > 0) for number in (0, 1, 2, 0)]
    rows = np.concatenate([shown(bits, rng, 2 * len(bits)) for bits in loops])
    assert compare(port, rows) == 4


def test_fine_runs_that_are_lost(port: Port) -> None:
    """Count slips, announced and not; frames are lost; scores are no numbers."""
    rng = np.random.default_rng(6)
    bits = encode(rng.bytes(400), 730)
    steps = np.arange(4 * len(bits))
    slips = noisy(bits[(steps + 11 * (steps // 9)) % len(bits)], 0.05, rng)
    odd = shown(bits, rng, 20)
    odd[:, :90] = np.nan
    odd[3:6] = 0
    odd[:, 100] = np.copysign(np.inf, odd[:, 100])
    assert compare(port, slips) == 1
    assert compare(port, slips, starts=steps[::9].tolist()) == 1
    assert compare(port, odd) == 1


@pytest.mark.slow
def test_the_finest_grid(port: Port) -> None:
    rng = np.random.default_rng(7)
    bits = encode(rng.bytes(2000), 11674)
    assert compare(port, shown(bits, rng, 40, 5, 0.2, 0.1)) == 1
