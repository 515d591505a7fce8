"""The page's collectors return the same messages at the same frames as Python's."""

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import slow
from numpy.typing import NDArray
from web_fixtures import run_node_tests, write_fixture

from link.code.collect import make_collector
from link.code.framing import encode

Scores = NDArray[np.float32]


def noisy(bits: NDArray[np.integer], ber: float, rng: np.random.Generator) -> Scores:
    """Log-likelihood ratios of a binary symmetric channel."""
    signs = (2.0 * bits - 1) * np.where(rng.random(bits.shape) < ber, -1, 1)
    return np.asarray(np.log((1 - ber) / ber) * signs, np.float32)


def shown(
    bits: NDArray[np.integer],
    rng: np.random.Generator,
    frames: int,
    start: int = 0,
    ber: float = 0.02,
    erased: float = 0.0,
) -> Scores:
    """Scores of a display that shows a loop from a frame on: (frames, n_bits)."""
    rows = noisy(bits[np.arange(start, start + frames) % len(bits)], ber, rng)
    rows[rng.random(rows.shape) < erased] = 0
    return rows


def heard(rows: Scores, starts: Iterable[int] = (), counts: Iterable[int] = ()) -> dict[str, Any]:
    """What a collector says to each row.

    Args:
        rows: (frames, n_bits) scores.
        starts: rows before which a run starts.
        counts: of all frames; by default those from 1000 on.
    """
    collector = make_collector(rows.shape[1])
    counts, starts = list(counts) or [*range(1000, 1000 + len(rows))], list(starts)
    steps, messages = [], []
    for at, (row, count) in enumerate(zip(rows, counts, strict=True)):
        if at in starts:
            collector.start_run()
        message = collector.add(row, count)
        steps.append([collector.progress, collector.attempts, collector.collecting])
        if message is not None:
            data = np.frombuffer(message.data, np.uint8)
            numbers = [message.frames, message.seen, message.agreement, message.changed]
            messages.append({"at": at, "data": data, "numbers": np.array(numbers, float)})
    return {
        "rows": rows,
        "counts": counts,
        "starts": starts,
        "steps": np.array(steps, float),
        "messages": messages,
    }


def compare(folder: Path, sequences: list[dict[str, Any]], messages: list[int]) -> None:
    """Hold the page's collector against what Python's said, and how many messages came."""
    assert [len(sequence["messages"]) for sequence in sequences] == messages
    write_fixture(folder, "sequences", sequences)
    run_node_tests("codeCollect", folder)


@pytest.mark.parametrize("ber", [0.001, 0.05])
def test_a_coarse_loop_is_joined_at_every_start(tmp_path: Path, ber: float) -> None:
    rng = np.random.default_rng(0)
    bits = encode(rng.bytes(12), 59)
    sequences = [heard(shown(bits, rng, 14, start, ber, erased=0.1)) for start in range(len(bits))]
    compare(tmp_path, sequences, [1] * len(bits))


def test_coarse_messages_that_change(tmp_path: Path) -> None:
    """Of equal length, with one bit changed, longer; then the first again."""
    rng = np.random.default_rng(1)
    first = rng.bytes(12)
    texts = [first, rng.bytes(12), first[:-1] + bytes([first[-1] ^ 1]), rng.bytes(30), first]
    loops = [encode(text, 59) for text in texts]
    rows = np.concatenate([shown(bits, rng, 4 * len(bits)) for bits in loops])
    compare(tmp_path, [heard(rows)], [5])


def test_coarse_runs_that_are_lost(tmp_path: Path) -> None:
    """Count slips unannounced; runs start; scores are no numbers; a third is covered and sure."""
    rng = np.random.default_rng(2)
    bits = encode(rng.bytes(40), 59)
    steps = np.arange(40)
    slips = noisy(bits[(steps + 3 * (steps // 9)) % len(bits)], 0.03, rng)
    covered = shown(bits, rng, 30)
    covered[::4, 10:30] = 8 * rng.choice([-1, 1], covered[::4, 10:30].shape)
    odd = shown(bits, rng, 30)
    odd[:, 9] = np.nan
    odd[:, 11] *= np.inf
    sequences = [
        heard(slips),
        heard(covered, starts=[7, 11]),
        heard(odd, counts=range(0, 30)),
    ]
    compare(tmp_path, sequences, [1, 1, 1])


def test_wrong_scores_are_no_message(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    bits = encode(rng.bytes(12), 59)
    bodies = shown(bits, rng, 16)
    bodies[:, 8:] = rng.normal(0, 6, bodies[:, 8:].shape)
    noise = rng.normal(0, 6, (6, 59)).astype(np.float32)
    fine = rng.normal(0, 6, (20, 730)).astype(np.float32)
    mixed = encode(bytes(300), 730, 2.0)
    mixed[:, 300:] = encode(bytes(299) + b"\1", 730, 2.0)[:, 300:]
    sequences = [heard(rows) for rows in (bodies, noise, fine, shown(mixed, rng, 16))]
    compare(tmp_path, sequences, [0, 0, 0, 0])


@pytest.mark.parametrize(("n_bits", "ber"), [(730, 0.05), slow(2918, 0.1)])
def test_a_fine_loop_is_joined_at_every_start(tmp_path: Path, n_bits: int, ber: float) -> None:
    rng = np.random.default_rng(4)
    bits = encode(rng.bytes(n_bits // 8), n_bits)
    sequences = [heard(shown(bits, rng, 13, start, ber, 0.2)) for start in range(len(bits))]
    compare(tmp_path, sequences, [1] * len(bits))


def test_fine_messages_that_change(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    texts = [rng.bytes(340), rng.bytes(340), rng.bytes(100)]
    loops = [encode(texts[number], 730) for number in (0, 1, 2, 0)]
    rows = np.concatenate([shown(bits, rng, 2 * len(bits)) for bits in loops])
    compare(tmp_path, [heard(rows)], [4])


def test_fine_runs_that_are_lost(tmp_path: Path) -> None:
    """Count slips, announced and not; frames are lost; scores are no numbers."""
    rng = np.random.default_rng(6)
    bits = encode(rng.bytes(400), 730)
    steps = np.arange(4 * len(bits))
    slips = noisy(bits[(steps + 11 * (steps // 9)) % len(bits)], 0.05, rng)
    odd = shown(bits, rng, 20)
    odd[:, :90] = np.nan
    odd[3:6] = 0
    odd[:, 100] = np.copysign(np.inf, odd[:, 100])
    sequences = [heard(slips), heard(slips, starts=steps[::9].tolist()), heard(odd)]
    compare(tmp_path, sequences, [1, 1, 1])


@pytest.mark.slow
@pytest.mark.parametrize(("n_bytes", "ber"), [(20_000, 0.05), (2000, 0.2)])
def test_the_finest_grid(tmp_path: Path, n_bytes: int, ber: float) -> None:
    rng = np.random.default_rng(7)
    bits = encode(rng.bytes(n_bytes), 11674)
    compare(tmp_path, [heard(shown(bits, rng, 40, 5, ber, 0.1))], [1])
