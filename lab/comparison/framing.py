"""How often a message is lost, by the share of wrong bits.

Messages are coded, sent through a simulated binary symmetric channel, and decoded: by the code of
`link.code.framing`, and by Reed-Solomon where the package reedsolo is installed. ``--wrong`` also
counts how often a message comes that was not sent. All draws come from one stream of random
numbers, in a fixed order. So every batch of trials is told where in the stream it begins.
"""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from itertools import product
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from lab.study import Picture, Results, Study, StudyFlags, Workshop
from link.code.framing import SIGNATURE, decode, encode, frames_needed
from link.errors import ParameterError, at_least, each_once
from link.layout import make_layout
from link.types import Array
from reports.engine.checked import Count, Share
from reports.render.charts import Point, Series, draw_series, in_style, new_panels
from reports.render.tables import Table, share_interval
from reports.score.intervals import wilson

LOOPS = (1, 2, 3)
"""Numbers of loops of the message that the receiver adds up."""
BATCH = 1000
"""Number of decodes in a batch of those in which wrong messages are counted."""
RANDOM, NOISY = 100_000, 10_000
"""Number of decodes in which wrong messages are counted: of random scores, and of messages with
wrong bits."""
NOISY_BER = (0.05, 0.3)
"""Least and largest share of wrong bits in a message in which wrong messages are counted."""


@dataclass(frozen=True)
class FramingFlags(StudyFlags):
    """Message failure against the share of wrong bits (simulated binary symmetric channel)."""

    n_bytes: int = 100
    """Length of the message, bytes."""
    trials: int = 200
    """Number of messages for each code, number of loops and share of wrong bits."""
    ber: tuple[float, ...] = (0.02, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.12)
    """Shares of wrong bits, more than 0 and less than 1."""
    wrong: bool = False
    """Count wrong messages, too: 100,000 decodes of random scores, 10,000 at 5 to 30 %."""


@dataclass(frozen=True)
class Trial:
    """Scores of the bits of a loop, and what they should give."""

    scores: Array
    """Summed log-likelihood ratios of the coded bits."""
    message: bytes
    """What was sent; empty where the scores are random."""


@dataclass(frozen=True)
class Batch:
    """Some trials of one kind, and where in the stream of random numbers they begin."""

    kind: str
    """Key of `CODES`, or "random" or "noisy"."""
    count: int
    """Number of trials."""
    state: Mapping[str, Any]
    """State of the generator of random numbers before the first trial."""
    loops: int = 1
    """Number of loops that the receiver adds up."""
    ber: float = 0.0
    """Share of wrong bits, for the kinds that are a code."""
    n_bytes: int = 0
    """Length of the message in bytes, for the kinds that are a code."""


def received_llr(
    bits: NDArray[np.integer], ber: float, loops: int, rng: np.random.Generator
) -> Array:
    """Send bits through a binary symmetric channel, and add up what comes.

    Args:
        bits: 0 or 1, of any shape.
        ber: share of wrong bits, in (0, 1).
        loops: number of times that the bits are sent.
        rng: draws which of them are flipped.

    Returns:
        summed log-likelihood ratios of the bits, natural logarithm, in the shape of ``bits``.
    """
    flips = np.where(rng.random((loops, *bits.shape)) < ber, -1.0, 1.0)
    return np.asarray(np.log((1 - ber) / ber) * (2.0 * bits - 1) * flips.sum(axis=0))


def encode_ldpc(message: bytes, n_bits: int) -> NDArray[np.integer]:
    """Encode a message as `link.code.framing` does, without the frames' signatures."""
    return encode(message, n_bits)[:, SIGNATURE:].reshape(-1)


def reads_ldpc(llr: Array, message: bytes, n_bits: int) -> bool:
    """Whether `link.code.framing` reads a message from what came of `encode_ldpc`."""
    frames = llr.reshape(-1, n_bits - SIGNATURE)
    known = np.concatenate([np.zeros((len(frames), SIGNATURE)), frames], axis=1)
    return decode(known) == (message, False)


def encode_reed_solomon(message: bytes, n_bits: int) -> NDArray[np.integer]:
    """Encode a message by Reed-Solomon over bytes, as long as `encode_ldpc` makes it."""
    codec, _ = _reed_solomon(len(message), n_bits)
    return np.unpackbits(np.frombuffer(bytes(codec.encode(message)), np.uint8))


def reads_reed_solomon(llr: Array, message: bytes, n_bits: int) -> bool:
    """Whether Reed-Solomon reads a message from what came of `encode_reed_solomon`.

    It tries three times, and takes none, the least certain third, and two thirds of as many bytes
    as there are parity bytes for erasures.
    """
    import reedsolo

    codec, parity = _reed_solomon(len(message), n_bits)
    data = np.packbits(llr > 0)
    certainty = np.abs(llr).reshape(-1, 8).min(axis=1)
    for share in (0.0, 0.33, 0.66):
        erased = np.argsort(certainty)[: int(share * parity)].tolist()
        try:
            if bytes(codec.decode(data.tobytes(), erase_pos=erased)[0]) == message:
                return True
        except reedsolo.ReedSolomonError:
            continue
    return False


def _reed_solomon(n_bytes: int, n_bits: int) -> tuple[Any, int]:
    """The codec for messages of a length, and the number of bytes that it could add."""
    import reedsolo

    length = encode(bytes(n_bytes), n_bits)[:, SIGNATURE:].size // 8
    parity = length - n_bytes
    return reedsolo.RSCodec(parity) if length <= 255 else reedsolo.RSCodec(128), parity


Encode = Callable[[bytes, int], NDArray[np.integer]]
"""Turns a message into coded bits, for frames of a number of bits."""
Reads = Callable[[Array, bytes, int], bool]
"""Whether a message is read from the scores of its coded bits, for frames of a number of bits."""
CODES: dict[str, tuple[Encode, Reads, str]] = {
    "LDPC (link.code.ldpc)": (encode_ldpc, reads_ldpc, ""),
    "Reed-Solomon with erasures": (encode_reed_solomon, reads_reed_solomon, "reedsolo"),
}
"""Codes by name: what encodes a message, whether it is read again, and the package needed."""


def draw_trials(batch: Batch, rng: np.random.Generator) -> Iterator[Trial]:
    """Draw the trials of a batch, in order."""
    n_bits = make_layout().n_bits
    for _ in range(batch.count):
        if batch.kind == "random":
            spread, frames = rng.uniform(0.5, 8), int(rng.integers(3, 7))
            yield Trial(rng.normal(0, spread, (frames, n_bits)), b"")
        elif batch.kind == "noisy":
            message = rng.bytes(int(rng.integers(1, 40)))
            bits = encode(message, n_bits)
            yield Trial(received_llr(bits, rng.uniform(*NOISY_BER), 1, rng), message)
        else:
            message = rng.bytes(batch.n_bytes)
            coded = CODES[batch.kind][0](message, n_bits)
            yield Trial(received_llr(coded, batch.ber, batch.loops, rng), message)


def count_decoded(batch: Batch) -> dict[str, int]:
    """Decode the trials of a batch.

    Returns:
        the number of trials in which a message came (``delivered``), which for the kinds that are
        a code is the one that was sent, and in which one came that was not sent (``wrong``).
    """
    rng = np.random.default_rng()
    rng.bit_generator.state = batch.state
    delivered = wrong = 0
    for trial in draw_trials(batch, rng):
        if batch.kind in CODES:
            delivered += CODES[batch.kind][1](trial.scores, trial.message, make_layout().n_bits)
            continue
        decoded = decode(trial.scores)
        delivered += decoded is not None
        wrong += decoded is not None and decoded.data != trial.message
    return {"delivered": delivered, "wrong": wrong}


def curve_batches(flags: FramingFlags, codes: list[str]) -> dict[str, Batch]:
    """Plan a batch for each code, number of loops and share of wrong bits."""
    rng = np.random.default_rng(flags.seed)
    batches = {}
    for code, loops, ber in product(codes, LOOPS, flags.ber):
        state = rng.bit_generator.state
        batch = Batch(code, flags.trials, state, loops, ber, flags.n_bytes)
        batches[f"{code}, {loops} loops, {ber:g}"] = batch
        for _ in draw_trials(batch, rng):
            pass  # moves the stream to where the next batch begins
    return batches


def wrong_batches(seed: int) -> dict[str, Batch]:
    """Plan the batches in which wrong messages are counted."""
    rng = np.random.default_rng(seed)
    batches = {}
    for kind, total in (("random", RANDOM), ("noisy", NOISY)):
        for first in range(0, total, BATCH):
            batch = Batch(kind, min(BATCH, total - first), rng.bit_generator.state)
            batches[f"{kind} {first}"] = batch
            for _ in draw_trials(batch, rng):
                pass
    return batches


@dataclass(frozen=True)
class LossRow:
    """Messages of one code that were lost at one share of wrong bits."""

    code: str
    """Name of the code."""
    loops: Count
    """Number of loops of the message that were added up."""
    ber: Share
    """Share of wrong bits."""
    messages: Count
    """Number of messages."""
    failed: Count
    """Number of messages that were not read."""
    failure: Share
    """Share of messages that were not read."""
    ci_low: Share
    """Lower end of Wilson's 95 % interval of this share."""
    ci_high: Share
    """Upper end of this interval."""


@dataclass(frozen=True)
class WrongRow:
    """Messages that came and were not sent."""

    scores: str
    """What was decoded, in words."""
    decodes: Count
    """Number of decodes."""
    delivered: Count
    """Number of decodes in which a message came."""
    wrong: Count
    """Number of these messages that were not sent."""


@dataclass(frozen=True)
class FramingContent:
    """What was measured."""

    rows: list[LossRow]
    """One row for each code, number of loops and share of wrong bits."""
    wrong: list[WrongRow] = field(default_factory=list)
    """One row for each kind of scores in which wrong messages are counted; empty without
    ``--wrong``."""


def loss_row(batch: Batch, found: Mapping[str, int]) -> LossRow:
    """State how many messages of a batch were lost."""
    failed = batch.count - found["delivered"]
    low, high = wilson(failed, batch.count)
    share = failed / batch.count
    return LossRow(batch.kind, batch.loops, batch.ber, batch.count, failed, share, low, high)


def wrong_rows(batches: dict[str, Batch], found: dict[str, Any]) -> list[WrongRow]:
    """State how many messages came that were not sent, for random scores and for wrong bits."""
    rows = []
    for kind, scores in (("random", "random"), ("noisy", "5 to 30 % of bits")):
        names = [name for name, batch in batches.items() if batch.kind == kind]
        total = sum(batches[name].count for name in names)
        delivered, wrong = (
            sum(found[name][count] for name in names) for count in ("delivered", "wrong")
        )
        rows.append(WrongRow(scores, total, delivered, wrong))
    return rows


def check_framing(flags: FramingFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, trials=flags.trials, n_bytes=flags.n_bytes)
    each_once(ber=flags.ber)
    for share in flags.ber:
        if not 0 < share < 1:
            raise ParameterError("ber", f"need shares between 0 and 1, got {share:g}")
    frames_needed(flags.n_bytes, make_layout().n_bits, "n_bytes")


def measure_framing(flags: FramingFlags, workshop: Workshop) -> FramingContent:
    """Decode all batches."""
    codes = [name for name, (_, _, package) in CODES.items() if not package or find_spec(package)]
    curves = curve_batches(flags, codes)
    counted = wrong_batches(flags.seed) if flags.wrong else {}
    found = workshop.each(count_decoded, curves | counted)
    rows = [loss_row(batch, found[name]) for name, batch in curves.items()]
    return FramingContent(rows, wrong_rows(counted, found) if counted else [])


def framing_blocks(results: Mapping[str, Results[FramingContent]]) -> dict[str, str]:
    """Tabulate lost messages, and wrong ones where they were counted."""
    content = results["framing"].content
    lost = [
        [
            row.code,
            str(row.loops),
            f"{row.ber:.2f}",
            f"{row.failed} of {row.messages}",
            share_interval(row.ci_low, row.ci_high, 1),
        ]
        for row in content.rows
    ]
    heads = ["code", "loops", "share of wrong bits", "messages lost", "95 % interval, %"]
    blocks = {"framing_lost": Table(heads, lost).markdown()}
    wrong = [
        [row.scores, f"{row.decodes:,}", str(row.delivered), str(row.wrong)]
        for row in content.wrong
    ]
    if wrong:
        heads = ["scores", "decodes", "messages that came", "not sent"]
        blocks["framing_wrong"] = Table(heads, wrong).markdown()
    return blocks


@in_style
def framing_figure(rows: list[LossRow]) -> Figure:
    """Draw lost messages against the share of wrong bits, a panel for each number of loops."""
    figure, panels = new_panels(len(LOOPS), legend=2.7, size=(7.3, 3.2), title=True)
    limits = {"xlim": (0, 105 * max(row.ber for row in rows)), "ylim": (-2, 102)}
    for loops, panel in zip(LOOPS, panels, strict=True):
        panel.set(title=f"{loops} loop{'s' * (loops > 1)}", xlabel="bits wrong, %", **limits)
        lines = []
        for code in dict.fromkeys(row.code for row in rows):
            points = [
                Point(100 * row.ber, 100 * row.failure, 100 * row.ci_low, 100 * row.ci_high)
                for row in rows
                if row.code == code and row.loops == loops
            ]
            lines.append(Series(code, points))
        draw_series(panel, lines)
        panel.set_ylabel("messages lost, %")
    return figure


def framing_pictures(results: Mapping[str, Results[FramingContent]]) -> dict[str, Picture]:
    """Draw the curves."""
    return {"framing.png": framing_figure(results["framing"].content.rows)}


STUDY = Study(
    name="framing",
    flags=FramingFlags,
    content=FramingContent,
    measure=measure_framing,
    blocks=framing_blocks,
    pictures=framing_pictures,
    check=check_framing,
)
"""The study that `python -m lab framing` runs."""
