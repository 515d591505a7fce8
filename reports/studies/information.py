"""How much must be received until a message is read: python -m reports.studies.information.

A receiver joins the loop at a random bit of its code and reads on, loop after loop, over a
simulated binary symmetric channel whose share of wrong bits it knows. What is measured is the
information received when the message can be read, as a multiple of the message's: a receiver of an
ideal code, which is the bound, needs 1. The codes are those of fine grids (`link.code.rateless`)
and of coarse grids (`link.code.ldpc`), with one message.

A second table says how fast messages of 20 kilobytes are decoded on one core. Times depend on the
machine; the table states them beside a yardstick that was timed in the same run, in turn.
"""

import bisect
import json
import os
import time
from dataclasses import asdict, dataclass
from itertools import product
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from matplotlib.figure import Figure

from link.cli import read_flags, run_cli
from link.code.collect_fine import FIRST_TRY, NEXT_TRY
from link.code.fine import Terms
from link.code.framing import encode
from link.code.ldpc import make_code
from link.errors import ParameterError, at_least, each_once
from link.files.lock import locked
from link.images import write_bytes
from reports.engine.backends import Backend
from reports.engine.provenance import provenance
from reports.engine.stored import all_results
from reports.render.charts import Point, Series, draw_series, in_style, new_panels, save_png
from reports.render.tables import Table
from reports.studies.framing import received_llr

STEP = 0.02
"""Resolution of the information needed, as a share of the message's."""
MOST = 2.5
"""Information over the message's at which a message counts as lost."""
LOOP = {"rateless (fine grids)": 6, "IRA, rate 1/2 (coarse grids)": 2}
"""Number of coded bits in a loop for each bit of the message, by the name of the code."""
SPEED_BYTES = 20_000
"""Length of the message whose decoding is timed, in bytes."""
SPEED_INFORMATION = 1.2
"""Information received over the message's when decoding is timed."""


@dataclass(frozen=True)
class InformationConfig:
    """Information received until a message is read, and time to decode."""

    out: Path = Path("runs/information")
    """Folder for information.json and information.png."""
    n_bytes: int = 1000
    """Length of the message, bytes."""
    trials: int = 6
    """Number of messages for each code and share of wrong bits."""
    ber: tuple[float, ...] = (0.001, 0.02, 0.05, 0.08, 0.11, 0.15, 0.2)
    """Shares of wrong bits, more than 0 and less than 0.5."""
    seed: int = 0
    """Seed of the random numbers."""
    jobs: int = os.cpu_count() or 1
    """Number of processes; decoding is timed in one."""


@dataclass(frozen=True)
class MessageTrial:
    """One message that is read over one channel."""

    code: str
    """Key of `LOOP`."""
    ber: float
    """Share of wrong bits."""
    n_bytes: int
    """Length of the message, bytes."""
    seed: tuple[int, int, int]
    """Seed of the random numbers."""


def capacity_of(ber: float) -> float:
    """Give the capacity of a binary symmetric channel, in bits for each bit sent.

    >>> round(capacity_of(0.11), 3)
    0.5
    """
    return float(1 + ber * np.log2(ber) + (1 - ber) * np.log2(1 - ber))


def information_needed(drawn: MessageTrial) -> float:
    """Read a message; returns the information received over the message's, or infinity."""
    rng = np.random.default_rng(drawn.seed)
    bits = 8 * drawn.n_bytes
    size = LOOP[drawn.code] * bits
    fine = drawn.code.startswith("rateless")
    if fine:
        terms = Terms(drawn.n_bytes - 4, 8, 0)
        blocks = rng.integers(0, 2, (terms.information // terms.blocks, terms.blocks), np.uint8)
        sent = terms.code.encode(blocks, -(-size // terms.blocks)).reshape(-1)
        order = np.roll(np.arange(sent.size), int(rng.integers(sent.size)))
    else:
        code = make_code(bits, size - bits)
        sent, order = code.encode(rng.integers(0, 2, bits)), rng.permutation(size)
    share_of_bit = capacity_of(drawn.ber) / bits
    order = np.resize(order, int(MOST / share_of_bit))
    llr = received_llr(sent[order], drawn.ber, 1, rng)

    def is_read(share: float) -> bool:
        many = int(share / share_of_bit)
        sums = np.bincount(order[:many], llr[:many], minlength=sent.size)
        if fine:
            found, done = terms.code.decode(sums.reshape(-1, terms.blocks).astype(np.float32))
            return bool(done.all()) and np.array_equal(found, blocks)
        word = code.decode(np.asarray(sums, np.float64))
        return word is not None and np.array_equal(word, sent)

    # what is enough stays enough, so halving the range finds the least that is
    shares = np.arange(1, MOST, STEP)
    at = bisect.bisect_left(shares, True, key=is_read)
    return float(shares[at]) if at < shares.size else float("inf")


def curve_rows(config: InformationConfig) -> list[dict[str, Any]]:
    """Measure the information needed for each code and share of wrong bits."""
    cells = list(product(LOOP, config.ber))
    receptions = [
        MessageTrial(code, ber, config.n_bytes, (config.seed, number, trial))
        for number, (code, ber) in enumerate(cells)
        for trial in range(config.trials)
    ]
    needed = all_results(information_needed, receptions, Backend(config.jobs), "messages")
    by_cell = np.array(needed).reshape(len(cells), config.trials)
    return [
        {
            "code": code,
            "ber": ber,
            "messages": config.trials,
            "median": float(np.median(values)),
            "least": float(values.min()),
            "most": float(values.max()),
        }
        for (code, ber), values in zip(cells, by_cell, strict=True)
    ]


def yardstick_s() -> float:
    """Time one warp of a 1280 x 720 frame to 512 x 384 pixels by OpenCV on one thread, seconds."""
    frame = np.zeros((720, 1280, 3), np.uint8)
    homography = np.array([[0.4, 0.02, 3], [0.01, 0.5, 5], [1e-5, 2e-5, 1]])
    begin = time.process_time()
    for _ in range(20):
        cv2.warpPerspective(frame, homography, (512, 384), flags=cv2.INTER_LINEAR)
    return (time.process_time() - begin) / 20


def speed_rows(config: InformationConfig) -> list[dict[str, Any]]:
    """Time the decoding of a message of 20 kilobytes, processor time of one core."""
    cv2.setNumThreads(1)
    rows = []
    terms = Terms(SPEED_BYTES, 8, 0)
    shape = (terms.information // terms.blocks, terms.blocks)
    for number, ber in enumerate(ber for ber in config.ber if ber >= 0.02):
        rng = np.random.default_rng((config.seed, 99, number))
        blocks = rng.integers(0, 2, shape, np.uint8)
        count = int(SPEED_INFORMATION * shape[0] / capacity_of(ber))
        llr = received_llr(terms.code.encode(blocks, count), ber, 1, rng)
        warp, spent = [], []
        for _ in range(5):
            warp.append(yardstick_s())
            begin = time.process_time()
            found, done = terms.code.decode(llr)
            spent.append(time.process_time() - begin)
        seconds = float(np.median(spent))
        rows.append(
            {
                "ber": ber,
                "read": bool(done.all() and np.array_equal(found, blocks)),
                "seconds": seconds,
                "kbit_per_s": 8 * SPEED_BYTES / seconds / 1000,
                "warps": seconds / float(np.median(warp)),
                "warp_ms": 1000 * float(np.median(warp)),
            }
        )
    return rows


def making_seconds() -> dict[str, float]:
    """Time what comes before decoding: making a code, and encoding 20 kilobytes."""
    begin = time.process_time()
    make_code(8 * 2500, 8 * 2500)
    coarse = time.process_time() - begin
    begin = time.process_time()
    encode(bytes(SPEED_BYTES), 2918)
    return {"make_code_2500_bytes": coarse, "encode_fine": time.process_time() - begin}


@in_style
def information_figure(rows: list[dict[str, Any]]) -> Figure:
    """Draw the information needed against the share of wrong bits, for each code and the bound."""
    figure, (panel,) = new_panels(1, legend=2.6, size=(6.6, 3.4))
    lines = []
    for code in LOOP:
        mine = [row for row in rows if row["code"] == code and np.isfinite(row["most"])]
        points = [Point(100 * r["ber"], r["median"], r["least"], r["most"]) for r in mine]
        lines.append(Series(code, points))
    shares = sorted({100 * row["ber"] for row in rows})
    lines.append(Series("bound", [Point(share, 1, 1, 1) for share in shares]))
    highest = max(point.high for line in lines for point in line.points)
    panel.set(
        xlabel="bits wrong, %",
        ylabel="information needed / message",
        xlim=(0, 1.05 * shares[-1]),
        ylim=(0.95, 1.03 * highest),
    )
    draw_series(panel, lines)
    return figure


def information_table(content: dict[str, Any]) -> str:
    """Write the tables of docs/framing.md, from the content of information.json."""
    needed = []
    for ber in dict.fromkeys(row["ber"] for row in content["rows"]):
        cells = [
            f"{row['median']:.2f} ({row['least']:.2f} – {row['most']:.2f})"
            for code in LOOP
            for row in content["rows"]
            if (row["code"], row["ber"]) == (code, ber)
        ]
        needed.append([f"{100 * ber:g}", *cells])
    speed = []
    for row in content["speed"]:
        read = [f"{row['kbit_per_s']:.0f}", f"{row['warps']:.0f}"] if row["read"] else None
        speed.append([f"{100 * row['ber']:g}", *(read or ["not read", "–"])])
    heads = ["bits wrong, %", "decoded, kbit/s", "time of decoding / time of a warp"]
    tables = Table(["bits wrong, %", *LOOP], needed, left=0), Table(heads, speed, left=0)
    return "\n\n".join(table.markdown() for table in tables)


def main() -> None:
    """Measure, print, write information.json and information.png."""
    config = read_flags(lambda: tyro.cli(InformationConfig))
    at_least(1, trials=config.trials, jobs=config.jobs)
    at_least(32, n_bytes=config.n_bytes)
    at_least(0, seed=config.seed)
    each_once(ber=config.ber)
    for share in config.ber:
        if not 0 < share < 0.5:
            raise ParameterError("ber", f"need shares between 0 and 0.5, got {share:g}")
    with locked(config.out):
        content: dict[str, Any] = {
            "meta": provenance(config.seed, True),
            "tries": {"first": FIRST_TRY, "next": NEXT_TRY},
            "config": {name: value for name, value in asdict(config).items() if name != "out"},
            "speed": speed_rows(config),
            "making_s": making_seconds(),
            "rows": curve_rows(config),
        }
        print(information_table(content))
        print(content["making_s"])
        save_png(information_figure(content["rows"]), config.out / "information.png")
        text = json.dumps(content, indent=1) + "\n"
        write_bytes(config.out / "information.json", text.encode())


if __name__ == "__main__":
    run_cli(main)
