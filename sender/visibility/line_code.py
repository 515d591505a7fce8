"""Line codes: what one block shows over the refreshes of the display for a row of bits.

A block toggles between two states, each shown for some refreshes, and two states carry a bit. Both
codes swing by kappa:

| code | what is shown for a 1; for a 0, in units of kappa |
|---|---|
| `on_off` | 0, 1; 0, 0 (the paper: kappa is added in the second state where the bit is 1) |
| `toggle` | -½, +½; +½, -½ (antipodal) |
"""

import numpy as np
from numpy.typing import ArrayLike

from link.errors import InputError, at_least, choose
from link.types import Array

LINE_CODES = {"on_off": ((0.0, 0.0), (0.0, 1.0)), "toggle": ((0.5, -0.5), (-0.5, 0.5))}
"""By name, what the two states show for a 0 and for a 1, in units of kappa."""
CODE_OF_MODULATION = {"on_off": "on_off", "antipodal": "toggle"}
"""By the name of a modulation, a key of `link.layout.MODULATIONS`, the line code with which the
sender shows each bit once."""


def shown_amplitudes(line_code: str, bits: ArrayLike, refreshes: int = 1) -> Array:
    """Make what a block shows for a row of bits.

    Args:
        line_code: key of `LINE_CODES`.
        bits: (n,) 0 or 1.
        refreshes: number of refreshes of each state, at least 1.

    Returns:
        (n * 2 * refreshes,) amplitudes in units of kappa, one for each refresh.

    Raises:
        InputError: the line code is unknown, or the bits are of another shape or other values.

    >>> shown_amplitudes("toggle", [1, 0, 0])
    array([-0.5,  0.5,  0.5, -0.5,  0.5, -0.5])
    >>> shown_amplitudes("on_off", [1, 0], refreshes=2)
    array([0., 0., 1., 1., 0., 0., 0., 0.])
    """
    at_least(1, refreshes=refreshes)
    values = np.asarray(bits)
    if values.ndim != 1 or not np.isin(values, (0, 1)).all():
        raise InputError("bits: need one row of 0 and 1")
    states = np.array(choose(LINE_CODES, line_code, "line code"))[values.astype(np.intp)]
    return np.repeat(states.ravel(), refreshes)
