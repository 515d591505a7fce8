"""Line codes: what a block shows for a row of bits."""

import numpy as np
import pytest
from conftest import cases
from hypothesis import given
from hypothesis import strategies as st

from export.visibility.line_code import LINE_CODES
from link.errors import InputError, ParameterError

ANTIPODAL = [name for name in LINE_CODES if name != "on_off"]
BITS = st.lists(st.integers(0, 1), min_size=1, max_size=12)


@cases(
    ("on_off", [0, 1, 0, 0]),
    ("toggle", [-0.5, 0.5, 0.5, -0.5]),
    ("hold2", [-0.5, 0.5, -0.5, 0.5, 0.5, -0.5, 0.5, -0.5]),
    ("balanced", [-0.5, 0.5, 0.5, -0.5, 0.5, -0.5, -0.5, 0.5]),
)
def test_a_one_and_a_zero(name: str, expected: list[float]) -> None:
    assert LINE_CODES[name].amplitudes([1, 0]).tolist() == expected


@pytest.mark.parametrize("name", LINE_CODES)
@given(bits=BITS, refreshes=st.integers(1, 4))
def test_every_code_takes_its_time_and_swings_by_kappa(
    name: str, bits: list[int], refreshes: int
) -> None:
    code = LINE_CODES[name]
    shown = code.amplitudes(bits, refreshes)
    assert shown.shape == (len(bits) * 2 * code.toggles * refreshes,)
    assert np.ptp(shown) <= 1
    assert np.abs(shown).max() <= (1 if name == "on_off" else 0.5)


@pytest.mark.parametrize("name", ANTIPODAL)
@given(bits=BITS, refreshes=st.integers(1, 4))
def test_the_other_bits_show_the_opposite(name: str, bits: list[int], refreshes: int) -> None:
    code = LINE_CODES[name]
    flipped = [1 - bit for bit in bits]
    np.testing.assert_array_equal(
        code.amplitudes(bits, refreshes), -code.amplitudes(flipped, refreshes)
    )


@pytest.mark.parametrize("name", ["toggle", "hold2", "hold4", "balanced"])
@given(bits=BITS)
def test_every_bit_has_no_mean(name: str, bits: list[int]) -> None:
    shown = LINE_CODES[name].amplitudes(bits).reshape(len(bits), -1)
    np.testing.assert_array_equal(shown.sum(axis=1), 0)


@given(bits=BITS)
def test_balanced_bits_have_no_slope(bits: list[int]) -> None:
    shown = LINE_CODES["balanced"].amplitudes(bits).reshape(-1, 4)
    np.testing.assert_array_equal(shown @ np.arange(4), 0)


@cases(("soft2", "hold2"), ("soft4", "hold4"))
def test_soft_is_hold_where_the_sign_stays(soft: str, hold: str) -> None:
    for bits in ([1, 1, 1], [0, 0]):
        np.testing.assert_allclose(
            LINE_CODES[soft].amplitudes(bits, 2), LINE_CODES[hold].amplitudes(bits, 2)
        )
    assert LINE_CODES[soft].energy() < LINE_CODES[hold].energy()


def test_a_soft_step_is_a_raised_cosine() -> None:
    shown = LINE_CODES["soft2"].amplitudes([0, 1])
    envelope = shown * np.tile([-1, 1], 4)
    steps = 0.5 * -np.cos(np.pi * (np.arange(4) + 0.5) / 4)
    np.testing.assert_allclose(envelope[2:6], steps, atol=1e-12)


@pytest.mark.parametrize("name", ANTIPODAL)
def test_codes_differ_in_where_their_energy_lies(name: str) -> None:
    """Holding and soft steps leave less below a quarter of the rate of states than a toggle."""
    bits = np.random.default_rng(0).integers(0, 2, 4096)

    def low(code: str) -> float:
        power = np.abs(np.fft.rfft(LINE_CODES[code].amplitudes(bits))) ** 2
        return float(power[: len(power) // 2].sum() / power.sum())

    if name.startswith(("hold", "soft")):
        assert low(name) < low("toggle")
    elif name == "balanced":
        assert low(name) > low("toggle")


@pytest.mark.parametrize("bits", [[2], [[0, 1]], [0.5]])
def test_other_bits_are_refused(bits: list[int]) -> None:
    with pytest.raises(InputError, match="0 and 1"):
        LINE_CODES["toggle"].amplitudes(bits)
    with pytest.raises(ParameterError, match="refreshes"):
        LINE_CODES["toggle"].amplitudes([1], 0)
