"""A display that changes its message, and what must not be taken for a change."""

import zlib
from collections.abc import Iterable

import numpy as np
import pytest
from conftest import cases, exhaustive, slow
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scores import keeps_scores, noisy

from link.code.collect import MAX_SCORE, Collector, Message, make_collector
from link.code.framing import (
    CRC_BYTES,
    LENGTH_BYTES,
    code_of,
    decode,
    encode,
    information_bytes,
    parity_mask,
    signatures,
)
from link.code.scrambled import scrambled
from link.types import Array, Image

N_BITS = 59


def listen(
    collector: Collector, rows: Iterable[Array], count: int = 0
) -> list[tuple[int, Message]]:
    """Every message that came, with the number of rows until then."""
    came = []
    for number, scores in enumerate(rows, 1):
        message = collector.add(scores, count + number)
        if message is not None:
            came.append((number, message))
    return came


def shown(
    bits: NDArray[np.integer],
    loops: float,
    rng: np.random.Generator,
    ber: float = 0.02,
    at: int = 0,
) -> list[Array]:
    """Scores of a display that shows a loop from frame ``at`` on."""
    frames = range(at, at + round(loops * len(bits)))
    return [noisy(bits[frame % len(bits)], ber, rng) for frame in frames]


def other_message(kind: str, first: bytes, rng: np.random.Generator) -> bytes:
    return {
        "of equal length": rng.bytes(len(first)),
        "with one bit changed": first[:-1] + bytes([first[-1] ^ 1]),
        "longer": rng.bytes(len(first) + 13),
        "shorter": rng.bytes(len(first) // 2),
    }[kind]


@pytest.mark.parametrize("kind", ["of equal length", "with one bit changed", "longer", "shorter"])
@pytest.mark.parametrize("ber", [0.05, exhaustive(0.1)])
@pytest.mark.parametrize("begins", [slow("in step"), "anywhere"])
def test_a_changed_message_comes_within_two_loops(kind: str, ber: float, begins: str) -> None:
    """After 50 loops of another, which does not come again."""
    rng = np.random.default_rng(zlib.crc32(f"{kind}{begins}".encode()))
    first = rng.bytes(40)
    second = other_message(kind, first, rng)
    loops = encode(first, N_BITS), encode(second, N_BITS)
    collector = make_collector(N_BITS)
    came = listen(collector, shown(loops[0], 50, rng, ber))
    assert [(message.data, message.changed) for _, message in came] == [(first, False)]
    at = 0 if begins == "in step" else len(loops[1]) // 3
    count = 50 * len(loops[0])
    came = listen(collector, shown(loops[1], 12, rng, ber, at), count)
    assert [(message.data, message.changed) for _, message in came] == [(second, True)]
    assert came[0][0] <= 2 * len(loops[1])
    assert came[0][1].seen <= came[0][0]


def test_messages_that_take_turns_come_in_turn() -> None:
    rng = np.random.default_rng(0)
    texts = [b"the first message", b"another message", b"the third message"]
    collector, count, came = make_collector(N_BITS), 0, []
    for turn in range(9):
        rows = shown(encode(texts[turn % 3], N_BITS), 2, rng)
        came += [message.data for _, message in listen(collector, rows, count)]
        count += len(rows)
    assert came == texts * 3


@pytest.mark.parametrize(
    "again", ["a signature each frame that counts on", slow("a run of its own")]
)
def test_a_message_that_is_shown_on_is_returned_once(again: str) -> None:
    rng = np.random.default_rng(1)
    collector, came = make_collector(N_BITS), []
    for _ in range(20):
        came += listen(collector, shown(encode(b"one and the same", N_BITS), 3, rng))
        assert collector.progress > 0
        if again == "a run of its own":
            collector.start_run()
    assert [message.data for _, message in came] == [b"one and the same"]


DISTURBED_LOOPS = 20
"""Number of loops of each kind in which nothing but disturbances happen."""


def disturbed(kind: str, loop: NDArray[np.integer], rng: np.random.Generator) -> list[Array]:
    """Scores of one loop of a message that goes on."""
    rows = np.array(shown(loop, 1, rng))
    if kind == "a third is covered and looks certain":
        rows[:, 10:30] = MAX_SCORE * rng.choice([-1, 1], rows[:, 10:30].shape)
    elif kind == "noise":
        rows = rng.normal(0, 6, rows.shape)
    elif kind == "bodies of noise":
        rows[:, 8:] = rng.normal(0, 6, rows[:, 8:].shape)
    return list(rows)


@pytest.mark.slow
@cases(("noise", 4, 0.04, 0.04), ("a third is covered and looks certain", 4, 0.06, 0.15))
def test_disturbances_are_no_change(kind: str, every: int, starts: float, attempts: float) -> None:
    """Per frame: how often collecting began afresh for nothing, and how often it was decoded."""
    rng = np.random.default_rng(2)
    loop = encode(rng.bytes(30), N_BITS)
    collector = make_collector(N_BITS)
    assert len(listen(collector, shown(loop, 2, rng))) == 1
    tried, began, count = collector.attempts, 0, 0
    for number in range(DISTURBED_LOOPS):
        rows = disturbed(kind if number % every == 0 else "nothing", loop, rng)
        for scores in rows:
            before = keeps_scores(collector)
            count += 1
            assert collector.add(scores, count) is None
            began += keeps_scores(collector) and not before
    assert began <= starts * count
    assert collector.attempts - tried <= attempts * count
    # what was delivered still stands: its frames bring nothing new, and another message comes soon
    assert listen(collector, shown(loop, 4, rng), count) == []
    assert collector.progress == 1
    came = listen(collector, shown(encode(rng.bytes(30), N_BITS), 2, rng), count + 4 * len(loop))
    assert [message.changed for _, message in came] == [True]


@cases("noise", slow("bodies of noise"), slow("a third is covered and looks certain"))
def test_a_change_after_a_bad_time_comes_soon(kind: str) -> None:
    rng = np.random.default_rng(3)
    loops = [encode(rng.bytes(30), N_BITS) for _ in range(2)]
    collector = make_collector(N_BITS)
    listen(collector, shown(loops[0], 2, rng))
    for _ in range(3):
        assert listen(collector, disturbed(kind, loops[0], rng)) == []
    came = listen(collector, shown(loops[1], 4, rng), 1000)
    assert [message.changed for _, message in came] == [True]
    assert came[0][0] <= 4 * len(loops[1])


@settings(max_examples=20)
@given(st.binary(min_size=2, max_size=120), st.sampled_from([16, 59, 251]), st.data())
def test_a_small_change_of_the_message_changes_the_parity_bits_all_over(
    first: bytes, n_bits: int, data: st.DataObject
) -> None:
    at = data.draw(st.integers(0, len(first) - 1))
    second = first[:at] + bytes([first[at] ^ (1 << data.draw(st.integers(0, 7)))]) + first[at + 1 :]
    before, after = encode(first, n_bits), encode(second, n_bits)
    parity = parity_mask(len(before), n_bits)
    assert parity.sum() == code_of(*before.shape).parity
    assert 0.25 < (before != after)[parity].mean() < 0.75


def padded_loop(message: bytes, frames: int) -> Image:
    """A longer loop than the message needs, padded with zeros, its CRC-32 right."""
    room = information_bytes(frames, N_BITS) - CRC_BYTES
    data = (len(message).to_bytes(LENGTH_BYTES, "big") + message).ljust(room, b"\0")
    data += zlib.crc32(data).to_bytes(CRC_BYTES, "big")
    codeword = code_of(frames, N_BITS).encode(np.unpackbits(np.frombuffer(data, np.uint8)))
    words = scrambled(np.arange(codeword.size), codeword.size)
    order, white = np.argsort(words, kind="stable"), (words & np.uint64(1)).astype(np.uint8)
    heads = np.unpackbits(signatures(frames)[:, None], axis=1)
    return np.concatenate([heads, (codeword[order] ^ white).reshape(frames, -1)], axis=1)


def test_a_longer_loop_than_the_message_needs_is_refused() -> None:
    """No sender makes one; it once ended the receiver with an error."""
    np.testing.assert_array_equal(padded_loop(b"Hello", 4), encode(b"Hello", N_BITS))
    longer = padded_loop(b"Hello", 10)
    assert decode(8.0 * longer - 4) is None
    assert listen(make_collector(N_BITS), [8.0 * row - 4 for row in [*longer] * 5]) == []
