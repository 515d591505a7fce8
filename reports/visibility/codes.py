"""Line codes at equal visibility: how many bits a second each carries.

The model: a decoder with a matched filter, in white noise. The signal-to-noise ratio of a bit is
(kappa / noise)² times the code's energy, where ``noise`` is the kappa at which one antipodal
toggle has a ratio of 1, for the grid at hand and whatever the rate. Bits carry the mutual
information of a binary antipodal input in Gaussian noise of that ratio.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import norm

from export.visibility.flicker import largest_kappa, message_visibility
from export.visibility.line_code import LINE_CODES
from export.visibility.viewing import Viewing
from reports.render.charts import in_style, new_panels, set_ticks
from reports.render.tables import Table, TableCell

SETTINGS = ((60, 15), (60, 30), (60, 60), (120, 60), (120, 120))
"""Refreshes and states a second that are compared."""
ERRORS = (0.05, 0.17, 0.35)
"""Shares of bits that one toggle of kappa 1 is taken to leave wrong: assumed, from a coarse grid
seen well to a fine one seen badly."""
REFERENCE = "toggle"
"""Line code to which the others are compared."""
_NODE, _WEIGHT = np.polynomial.hermite_e.hermegauss(60)


def noise_of(error: float) -> float:
    """Find the kappa at which a toggle has a signal-to-noise ratio of 1.

    Args:
        error: share of bits, in (0, 0.5), that one antipodal toggle of kappa 1 leaves wrong.

    >>> round(noise_of(0.1587), 3)
    1.0
    """
    return float(1 / norm.isf(error))


def bits_known(snr: float) -> float:
    """Work out the mutual information of one antipodal bit in Gaussian noise.

    Args:
        snr: squared amplitude over the variance of the noise, at least 0.

    Returns:
        bits, in [0, 1].

    >>> [round(bits_known(snr), 3) for snr in (0, 1, 100)]
    [0.0, 0.486, 1.0]
    """
    llr = 2 * snr + 2 * np.sqrt(snr) * _NODE
    lost = np.logaddexp(0, -llr) / np.log(2)
    return float(1 - np.sum(_WEIGHT * lost) / np.sum(_WEIGHT))


@dataclass(frozen=True)
class CodeResult:
    """A line code at a setting."""

    line_code: str
    """Name of the line code."""
    refresh_hz: int
    """Number of refreshes a second."""
    states_hz: int
    """Number of states a second."""
    bits_hz: float
    """Number of bits that a block shows a second."""
    visibility: float
    """Mean contrast over threshold of one block with kappa 1, levels not rounded."""
    kappa: float
    """Kappa, not rounded, at which the contrast over threshold is the limit."""
    energy_hz: float
    """Kappa² times energies of toggles a second at the limit: how well a block is heard."""
    whole_kappa: int
    """Largest whole kappa whose rounded levels stay below the limit in 95 % of half seconds."""
    known_hz: tuple[float, ...]
    """Bits a second that a block carries with the largest whole kappa, for each of `ERRORS`."""


def compare_codes(
    grid: tuple[int, int], limit: float, seed: int, seconds: float
) -> list[CodeResult]:
    """Compare all line codes at all settings, on the standard display over middle gray."""
    results = []
    for refresh_hz, states_hz in SETTINGS:
        viewing = Viewing(*grid, kappa=1, states_hz=states_hz, refresh_hz=refresh_hz)
        for name, code in LINE_CODES.items():
            seen = _mean_seen(viewing, name, seed, seconds)
            kappa = limit / seen
            for _ in range(3):  # light is not quite linear in gray levels
                kappa *= limit / _mean_seen(replace(viewing, kappa=kappa), name, seed, seconds)
            rounded = replace(viewing, whole_levels=True)
            whole = largest_kappa(rounded, limit, np.random.default_rng(seed), name, seconds)
            bits_hz = states_hz / 2 / code.toggles
            energy = code.energy()
            known = tuple(
                bits_hz * bits_known(energy * (whole / noise_of(error)) ** 2) for error in ERRORS
            )
            heard = bits_hz * energy * kappa**2
            results.append(
                CodeResult(name, refresh_hz, states_hz, bits_hz, seen, kappa, heard, whole, known)
            )
    return results


def _mean_seen(viewing: Viewing, name: str, seed: int, seconds: float) -> float:
    return message_visibility(viewing, name, np.random.default_rng(seed), seconds).mean


def code_table(results: Sequence[CodeResult]) -> Table:
    """Tabulate line codes at equal visibility."""
    first = {(r.refresh_hz, r.states_hz): r for r in results if r.line_code == REFERENCE}
    rows = []
    for r in results:
        times = r.energy_hz / first[r.refresh_hz, r.states_hz].energy_hz
        rows.append(
            [
                f"{r.states_hz} of {r.refresh_hz}",
                r.line_code,
                f"{r.bits_hz:g}",
                f"{r.visibility:.2f}",
                f"{r.kappa:.2f}",
                f"{times:.2f}",
                str(r.whole_kappa) if r.whole_kappa else "–",
                *(f"{known:.1f}" if r.whole_kappa else "–" for known in r.known_hz),
            ]
        )
    heads: list[str | TableCell] = [
        "states/s of refreshes/s",
        "line code",
        "raw bits/s",
        "seen at κ 1",
        "κ at the limit",
        f"energy/s, × {REFERENCE}",
        "whole κ",
        *(f"bits/s, {100 * e:g} % wrong" for e in ERRORS),
    ]
    return Table(heads, rows, left=2)


@in_style
def code_figure(results: Sequence[CodeResult]) -> Figure:
    """Draw how well a block is heard at equal visibility, by line code and rate."""
    figure, (panel,) = new_panels(legend=1.75, size=(7.6, 3.6))
    rates = sorted({r.states_hz for r in results})
    names = list(LINE_CODES)
    for rate, marker in zip(rates, "osD^", strict=True):
        refresh_hz = min(r.refresh_hz for r in results if r.states_hz == rate)
        rows = [r for r in results if (r.refresh_hz, r.states_hz) == (refresh_hz, rate)]
        heights = [names.index(r.line_code) for r in rows]
        panel.plot([r.energy_hz for r in rows], heights, marker, label=f"{rate} states/s")
    panel.set_xscale("log")
    least, most = (f(r.energy_hz for r in results) for f in (min, max))
    ticks = [10.0**k for k in range(-1, 5) if least / 2 <= 10.0**k <= 2 * most]
    set_ticks(panel.xaxis, ticks, [f"{tick:g}" for tick in ticks])
    set_ticks(panel.yaxis, list(range(len(names))), names)
    panel.tick_params(axis="y", labelsize=8)
    panel.grid(axis="both")
    panel.invert_yaxis()
    panel.set_xlabel("energy a second at the limit, toggles of κ 1 a second")
    panel.legend(loc="center left", bbox_to_anchor=(1.02, 0.5))
    return figure
