"""Message failure against raw bit error of the codes that a loop could use.

python -m reports.studies.framing: curves to docs/framing.{json,png}; --wrong counts wrong messages
in random scores and at 5 to 30 % of bit errors.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from link.code.framing import SIGNATURE, decode, encode
from link.images import write_bytes
from link.layout import make_layout
from reports.score.metrics import provenance, wilson

Array = NDArray[np.float64]
RANDOM, NOISY = 100_000, 10_000
"""Decodes in which wrong messages are counted."""


@dataclass(frozen=True)
class FramingConfig:
    """Message failure against raw bit error (simulated binary symmetric channel)."""

    out: Path = Path("runs/framing")
    n_bytes: int = 100
    """Length of the message."""
    trials: int = 200
    """Messages a point."""
    ber: tuple[float, ...] = (0.02, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.1, 0.12)
    wrong: bool = False
    """Count wrong messages, too: 100,000 decodes of random scores, 10,000 at 5 to 30 %."""
    seed: int = 0


def llr_of(bits: NDArray[np.integer], ber: float, loops: int, rng: np.random.Generator) -> Array:
    """Summed log-likelihood ratios of ``loops`` looks through a binary symmetric channel."""
    flips = np.where(rng.random((loops, *bits.shape)) < ber, -1.0, 1.0)
    return np.asarray(np.log((1 - ber) / ber) * (2.0 * bits - 1) * flips.sum(axis=0))


def ours(message: bytes, n_bits: int) -> tuple[NDArray[np.integer], Callable[[Array], bool]]:
    """Soft LDPC of `link.code.framing`."""
    bits = encode(message, n_bits)
    return (
        bits[:, SIGNATURE:].reshape(-1),
        lambda llr: (
            decode(
                np.concatenate(
                    [np.zeros((len(bits), SIGNATURE)), llr.reshape(len(bits), -1)], axis=1
                )
            )
            == message
        ),
    )


def reed_solomon(
    message: bytes, n_bits: int
) -> tuple[NDArray[np.integer], Callable[[Array], bool]]:
    """Reed-Solomon over bytes (`reedsolo`), of the same length; the least certain third erased."""
    import reedsolo

    length = encode(message, n_bits)[:, SIGNATURE:].size // 8
    parity = length - len(message)
    codec = reedsolo.RSCodec(parity) if length <= 255 else reedsolo.RSCodec(128)
    word = np.frombuffer(bytes(codec.encode(message)), np.uint8)

    def read(llr: Array) -> bool:
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

    return np.unpackbits(word), read


CODES: dict[str, tuple[Callable[..., Any], str | None]] = {
    "LDPC (link.code.ldpc)": (ours, None),
    "Reed-Solomon with erasures": (reed_solomon, "reedsolo"),
}
"""Code by name, and the package it needs."""


def curves(config: FramingConfig) -> list[dict[str, Any]]:
    """One row a code, number of loops and bit error rate."""
    rng = np.random.default_rng(config.seed)
    n_bits = make_layout().n_bits
    rows = []
    for name, (make, package) in CODES.items():
        if package is not None and find_spec(package) is None:
            print(f"{name}: skipped; pip install --no-deps {package}")
            continue
        for loops in (1, 2, 3):
            for ber in tqdm(config.ber, desc=f"{name}, {loops} loops"):
                failed = 0
                for _ in range(config.trials):
                    bits, read = make(rng.bytes(config.n_bytes), n_bits)
                    failed += not read(llr_of(bits, ber, loops, rng))
                low, high = wilson(failed, config.trials)
                rows.append(
                    {
                        "code": name,
                        "loops": loops,
                        "ber": ber,
                        "messages": config.trials,
                        "failed": failed,
                        "failure": failed / config.trials,
                        "ci_low": low,
                        "ci_high": high,
                    }
                )
    return rows


def count_wrong(seed: int) -> list[dict[str, Any]]:
    """Wrong messages among decodes of random scores, and of noisy messages of random length."""
    rng = np.random.default_rng(seed)
    n_bits = make_layout().n_bits
    random_wrong = delivered = wrong = 0
    for _ in tqdm(range(RANDOM), desc="random scores"):
        loop = rng.normal(0, rng.uniform(0.5, 8), (int(rng.integers(3, 7)), n_bits))
        random_wrong += decode(loop) is not None
    for _ in tqdm(range(NOISY), desc="bit errors"):
        message = rng.bytes(int(rng.integers(1, 40)))
        got = decode(llr_of(encode(message, n_bits), rng.uniform(0.05, 0.3), 1, rng))
        delivered += got is not None
        wrong += got is not None and got != message
    return [
        {"scores": "random", "decodes": RANDOM, "delivered": random_wrong, "wrong": random_wrong},
        {"scores": "5 to 30 % of bits", "decodes": NOISY, "delivered": delivered, "wrong": wrong},
    ]


def plot(rows: list[dict[str, Any]], path: Path) -> None:
    """Failure against bit error rate, a panel a number of loops."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 3, figsize=(10, 3), sharey=True)
    for loops, axis in zip((1, 2, 3), axes, strict=True):
        for name in dict.fromkeys(row["code"] for row in rows):
            points = [row for row in rows if row["code"] == name and row["loops"] == loops]
            x = [100 * row["ber"] for row in points]
            axis.plot(x, [100 * row["failure"] for row in points], "o-", ms=3, label=name)
            axis.fill_between(
                x,
                [100 * row["ci_low"] for row in points],
                [100 * row["ci_high"] for row in points],
                alpha=0.2,
            )
        axis.set(title=f"{loops} loop{'s' * (loops > 1)}", xlabel="bits wrong, %")
    axes[0].set_ylabel("messages lost, %")
    axes[0].legend(fontsize=7)
    figure.tight_layout()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main() -> None:
    """Measure, print, write framing.json and framing.png."""
    config = tyro.cli(FramingConfig)
    rows = curves(config)
    for row in rows:
        print(
            f"{row['code']:28} {row['loops']} loops, {row['ber']:.2f}: "
            f"{row['failed']} of {row['messages']} lost"
        )
    result: dict[str, Any] = {"meta": provenance(config.seed, True), "rows": rows}
    if config.wrong:
        result["wrong"] = count_wrong(config.seed)
        for entry in result["wrong"]:
            print(entry)
    plot(rows, config.out / "framing.png")
    write_bytes(config.out / "framing.json", (json.dumps(result, indent=1) + "\n").encode())


if __name__ == "__main__":
    from link.errors import run_cli

    run_cli(main)
