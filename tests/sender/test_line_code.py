"""Line codes: what a block shows for a row of bits."""

import numpy as np
import pytest
from conftest import cases

from link.errors import InputError, ParameterError
from sender.visibility.line_code import shown_amplitudes


@cases(
    ("on_off", [0, 1, 0, 0]),
    ("toggle", [-0.5, 0.5, 0.5, -0.5]),
)
def test_a_one_and_a_zero(name: str, expected: list[float]) -> None:
    assert shown_amplitudes(name, [1, 0]).tolist() == expected
    assert shown_amplitudes(name, [1, 0], 3).tolist() == np.repeat(expected, 3).tolist()


@pytest.mark.parametrize("bits", [[2], [[0, 1]], [0.5]])
def test_other_bits_are_refused(bits: list[int]) -> None:
    with pytest.raises(InputError, match="0 and 1"):
        shown_amplitudes("toggle", bits)
    with pytest.raises(ParameterError, match="refreshes"):
        shown_amplitudes("toggle", [1], 0)
