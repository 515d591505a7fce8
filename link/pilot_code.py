"""The code by which a display changes the order of its two states from frame pair to frame pair.

Pilots that always toggle with the same signs stand still for a camera of half the display's rate,
and look like picture. So a layout may have a code, a pseudo-random row of signs that sender and
receiver know: a frame pair of sign 1 shows its original first, one of sign -1 its embedded frame
first. All blocks then toggle the other way round, pilots among them, and their bits stay what they
are. Correlating with the code gives rate, phase and the number of the frame pair modulo the code's
period (as ranging codes do in satellite navigation).

The signs are no sequence of maximal length, since such a sequence is its own half: a camera that
sees every second frame pair would see the same code, shifted.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from link.code.scrambled import splitmix64
from link.errors import InputError

MOST_PERIOD = 1023
"""Largest period of a code, frame pairs."""
GENERATOR = "splitmix64"
"""Name of the generator of a code's signs (`link.code.scrambled`)."""
STATE_HZ = (
    *(15, 24, 25, 30, 36, 37.5, 45, 48, 50, 60),
    *(200 / 3, 70, 72, 75, 82.5, 85, 90, 100, 120, 144),
)
"""Numbers of states a second at which receivers look for a code: refresh rates of displays, and
whole parts of them."""
RATE_ERROR = 0.005
"""Share by which a display's number of states a second may differ from the next of these."""


@dataclass(frozen=True)
class PilotCode:
    """Signs of successive frame pairs: the highest bits of scrambled numbers from the seed on.

    The seed where it is absent is that of 30,000 whose signs agree least with themselves when they
    are shifted, or run at another rate: 9 of 63 at most, and 0.3 of them.

    Raises:
        InputError: the period or the seed is out of its range.

    >>> code = PilotCode()
    >>> code.signs[:8].tolist(), int(code.signs.sum())
    ([1, 1, -1, -1, -1, 1, 1, 1], -1)
    """

    period: int = 63
    """Number of frame pairs after which the code comes again."""
    seed: int = 3872
    """Number from which the signs follow, from 0 to 2**32."""

    def __post_init__(self) -> None:
        if not 1 <= self.period <= MOST_PERIOD:
            raise InputError(f"code: need a period of 1 to {MOST_PERIOD}, got {self.period}")
        if not 0 <= self.seed <= 2**32:
            raise InputError(f"code: need a seed of 0 to 2**32, got {self.seed}")

    def check_rate(self, state_hz: float) -> None:
        """Raise an `InputError` where receivers do not look for the code at this rate.

        Args:
            state_hz: number of states that the display shows in a second.
        """
        if self != PLAIN and not any(
            math.isclose(state_hz, known, rel_tol=RATE_ERROR) for known in STATE_HZ
        ):
            rates = ", ".join(f"{known:g}" for known in STATE_HZ)
            raise InputError(
                f"{state_hz:g} states a second: receivers find the code of this layout at {rates}"
            )

    @cached_property
    def signs(self) -> NDArray[np.intp]:
        """Array (period,) of 1 where the original frame comes first, and -1 where it comes last."""
        return 1 - 2 * (splitmix64(self.seed, self.period) >> np.uint64(63)).astype(np.intp)

    def sign(self, pair: int) -> int:
        """Give the sign of the frame pair with this number, which may be negative."""
        return int(self.signs[pair % self.period])

    def states_of(self, pair: int) -> tuple[int, int]:
        """Give the numbers of the states that show a pair's original and its embedded frame.

        >>> PilotCode().states_of(1), PilotCode().states_of(2)
        ((2, 3), (5, 4))
        """
        first, second = 2 * pair, 2 * pair + 1
        return (first, second) if self.sign(pair) > 0 else (second, first)

    def to_dict(self) -> dict[str, Any]:
        """Describe the code in JSON's types."""
        return {"period": self.period, "generator": GENERATOR, "seed": self.seed}

    @classmethod
    def from_dict(cls, data: Any) -> "PilotCode":
        """Make a code from what `to_dict` wrote.

        Raises:
            InputError: a key is missing, unknown or of the wrong type, or there is no such code.
        """
        if not isinstance(data, dict) or set(data) != {"period", "generator", "seed"}:
            raise InputError(f"code: need period, generator and seed, got {data!r:.100}")
        if data["generator"] != GENERATOR:
            raise InputError(f"code: the generator must be {GENERATOR}")
        if not all(type(data[key]) is int for key in ("period", "seed")):
            raise InputError(f"code: need whole numbers, got {data!r:.100}")
        return cls(data["period"], data["seed"])


PLAIN = PilotCode(period=1, seed=1)
"""No code: all frame pairs show their original first."""
