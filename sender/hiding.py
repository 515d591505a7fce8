"""How visible the message is to somebody who looks at the display, and the largest hidden kappa.

Visibility is contrast over threshold, where 1 is just seen (`sender.visibility.flicker`). A picture
has many levels, and a player may show many pictures; what counts is the most visible of a few gray
levels, whatever the picture (`sender.visibility.viewing.PICTURE_LEVELS`). The message is random,
and always the same.
"""

import bisect
import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from link.embed import MAX_KAPPA
from link.errors import ParameterError, in_range
from link.layout import Layout
from link.strength import even_factor, light_of_level
from sender.visibility.flicker import (
    contrast_over_threshold,
    high_end,
    random_message,
    stroboscopic_visibility,
)
from sender.visibility.viewing import PICTURE_LEVELS, Viewing, Where

PLAIN = 2.0
"""Contrast over threshold above which flicker is called plain to see; 1 is just seen."""
MOST_FLASHES, FLASH_LIGHT, FLASH_DARKER = 3, 0.1, 0.8
"""WCAG 2.2 (definition of the general flash and red flash thresholds): number of flashes a second
that is safe, the least change of relative luminance that counts as one, and the relative luminance
below which the darker of both states then is."""
SECONDS = 20.0
"""Length of the random message, in seconds; its high end is known to some percent."""
MESSAGE_SEED = 0
"""Seed of the random message."""
SAMPLE_HZ = 60.0
"""Least number of times a second at which the shown light is sampled. A display holds its light
while a state lasts, so that more samples, or other refreshes, change nothing."""
SLOWEST_HZ = 1.0
"""Number of states a second for which slower ones are taken; those are seen less."""
SLOWER = (1, 5 / 6, 2 / 3, 1 / 2, 1 / 3, 1 / 4)
"""Shares of the rate asked for at which flicker is judged, as a display may slow down."""


@dataclass(frozen=True)
class Onlooker:
    """Somebody who looks at the display.

    Raises:
        ParameterError: a value is out of range.
    """

    diagonal: float = Viewing.diagonal_inch
    """Diagonal of the picture on the display, in inches."""
    luminance: float = Viewing.white_cd_m2
    """Luminance of the display's white, in cd/m²; its black has a thousandth of it."""
    distance: float = Viewing.distance_m
    """Distance of the eye from the display, in metres."""

    def __post_init__(self) -> None:
        in_range(
            self,
            diagonal=(0.1, 10_000, ""),
            luminance=(1, 100_000, ""),
            distance=(0.01, 10_000, ""),
        )

    def viewing(self, layout: Layout, state_hz: float) -> Viewing:
        """Describe what is seen of a layout's blocks, for the module `sender.visibility.flicker`.

        Args:
            layout: what the display shows; it fills the diagonal.
            state_hz: states shown in a second.
        """
        states_hz = max(state_hz, SLOWEST_HZ)
        return Viewing(
            layout.rows,
            layout.cols,
            states_hz=states_hz,
            refresh_hz=states_hz * math.ceil(SAMPLE_HZ / states_hz),
            diagonal_inch=self.diagonal,
            aspect=layout.width / layout.height,
            distance_m=self.distance,
            white_cd_m2=self.luminance,
            black_cd_m2=self.luminance / 1000,
        )


@dataclass(frozen=True)
class Hiding:
    """A message of a layout at a rate, before the eyes of an onlooker.

    >>> from link.layout import make_layout
    >>> fine = make_layout(48, 64, modulation="antipodal", pilots=16)
    >>> hiding = Hiding(fine, state_hz=60, onlooker=Onlooker())
    >>> hiding.largest_kappa(limit=2.0)
    1
    """

    layout: Layout
    """Grid and modulation of the message."""
    state_hz: float
    """Number of states that are shown in a second."""
    onlooker: Onlooker
    """Size and brightness of the display, and the distance of the eye."""
    even: bool = False
    """Whether kappa is that of the most visible gray, and larger over others (`link.strength`)."""

    def seen(self, kappa: int, where: Where = "block") -> float:
        """Work out the high end of visibility: 95 % of the half seconds stay below it.

        Args:
            kappa: gray levels by which blocks change.
            where: "block" for one block, "screen" for all blocks in phase.

        Returns:
            contrast over threshold at the most visible level; 1 is just seen.
        """
        return max(self._seen_over(level, kappa, where) for level in PICTURE_LEVELS)

    def seen_in_motion(self, kappa: int) -> float:
        """Work out how visible a steady toggle is to eyes that move, at the most visible level.

        Returns:
            the stroboscopic visibility measure, of flicker from 80 Hz on; 1 is just seen.
        """
        viewings = [self._viewing(level, kappa) for level in PICTURE_LEVELS]
        toggle = np.repeat([-0.5, 0.5], viewings[0].refreshes)
        second = np.tile(toggle, math.ceil(self.state_hz / 2))
        return max(stroboscopic_visibility(second, viewing) for viewing in viewings)

    def flicker(self, kappa: int) -> str:
        """Say whether the message's flicker may disturb or harm somebody who looks at it.

        Args:
            kappa: gray levels by which blocks change.

        Returns:
            "flashes" where it exceeds the general flash threshold of WCAG 2.2 (success criterion
            2.3.1) over some gray: more than `MOST_FLASHES` pairs of opposite changes a second by at
            least `FLASH_LIGHT`; else "seen" where it is above `PLAIN`, or "".
        """
        dark = np.arange(256)
        dark = dark[light_of_level(dark) < FLASH_DARKER]
        factor = even_factor(light_of_level(dark)) if self.even else 1.0
        change = light_of_level(np.minimum(dark + kappa * factor, 255)) - light_of_level(dark)
        if self.state_hz / 2 > MOST_FLASHES and change.max() >= FLASH_LIGHT:
            return "flashes"
        return "seen" if self.seen(kappa) > PLAIN else ""

    def flickers(self, kappa: int) -> dict[float, str]:
        """Say what `flicker` finds by states a second: at the rate asked for, and at slower ones.

        >>> from link.presets import PRESETS
        >>> hidden = PRESETS["hidden"]
        >>> at_arms_length = Onlooker(distance=hidden.distance_m)
        >>> Hiding(hidden.layout, 60, at_arms_length, hidden.even).flickers(1)
        {60: '', 50.0: '', 40.0: '', 30.0: 'seen', 20.0: 'seen', 15.0: 'seen'}
        """
        rates = (self.state_hz * share for share in SLOWER)
        return {rate: replace(self, state_hz=rate).flicker(kappa) for rate in rates}

    @cache  # noqa: B019 - a few numbers, for one message a process
    def _seen_over(self, level: float, kappa: int, where: Where = "block") -> float:
        viewing = self._viewing(level, kappa)
        rng = np.random.default_rng(MESSAGE_SEED)
        shown = random_message(viewing, self.layout.modulation, rng, SECONDS)
        return high_end(contrast_over_threshold(shown, viewing, where))

    def _viewing(self, level: float, kappa: int) -> Viewing:
        factor = float(even_factor(light_of_level(level))) if self.even else 1.0
        viewing = self.onlooker.viewing(self.layout, self.state_hz)
        return replace(viewing, kappa=kappa * factor, picture_level=level)

    def largest_kappa(self, limit: float) -> int:
        """Find the largest kappa with which a block's visibility, `seen`, is at most a limit.

        Args:
            limit: contrast over threshold, above 0.

        Returns:
            1 to `link.embed.MAX_KAPPA`.

        Raises:
            ParameterError: the limit is not above 0, or even a kappa of 1 lies above it.
        """
        if not limit > 0:
            raise ParameterError("visibility", f"need a number above 0, got {limit:g}")
        least = {level: self._seen_over(level, 1) for level in PICTURE_LEVELS}
        worst = max(least, key=lambda level: least[level])
        if least[worst] > limit:
            raise ParameterError(
                "visibility",
                f"a kappa of 1 is at {least[worst]:.3g}, above {limit:g}; show more states a "
                "second, smaller blocks, antipodal ones, or allow more",
            )
        kappas = range(1, MAX_KAPPA + 1)
        kappa = bisect.bisect_right(kappas, limit, key=lambda kappa: self._seen_over(worst, kappa))
        while self.seen(kappa) > limit:  # another level has become the most visible
            kappa -= 1
        return kappa
