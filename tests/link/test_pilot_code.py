"""The code of the order of states: what is sent follows it, and files say which it is."""

import numpy as np
import pytest
from conftest import cases

from link.errors import InputError
from link.layout import Layout, make_layout
from link.loop import Loop, LoopStates
from link.pilot_code import PLAIN, PilotCode

CODED = make_layout(4, 4, modulation="antipodal", pilots=4, code=PilotCode(period=7))


def coded_loop(layout: Layout, frames: int) -> Loop:
    bits = np.arange(frames * layout.n_bits).reshape(frames, -1) % 3 == 0
    gray = np.full((layout.height, layout.width, 3), 128, np.uint8)
    return Loop(layout, 4, bits.astype(np.uint8), lambda: iter([gray]))


def test_a_code_agrees_little_with_itself_shifted_or_at_another_rate() -> None:
    signs = PilotCode().signs
    at = np.arange(5 * 63)
    assert abs(signs.sum()) == 1
    for shift in range(1, 63):
        assert abs((signs * np.roll(signs, shift)).sum()) <= 9
        for times, over in ((2, 1), (3, 2), (5, 4)):
            other = signs[(at * times // over + shift) % 63]
            assert abs((signs[at % 63] * other).mean()) <= 0.31


def test_a_layout_keeps_its_code_in_json_and_one_without_says_nothing() -> None:
    described = CODED.to_dict()
    assert described["code"] == {"period": 7, "generator": "splitmix64", "seed": 3872}
    assert Layout.from_dict(described).code == CODED.code
    plain = make_layout(4, 4, modulation="antipodal", pilots=4)
    assert "code" not in plain.to_dict()
    assert plain.code == PLAIN


@cases(
    {"period": 7},
    {"period": 0, "generator": "splitmix64", "seed": 1},
    {"period": 7, "generator": "lfsr", "seed": 1},
    {"period": 7.0, "generator": "splitmix64", "seed": 1},
    {"period": 7, "generator": "splitmix64", "seed": -1},
    [7],
)
def test_a_code_that_is_none_is_refused(wrong: object) -> None:
    with pytest.raises(InputError, match="code"):
        Layout.from_dict({**CODED.to_dict(), "code": wrong})


def test_a_code_needs_pilots() -> None:
    with pytest.raises(InputError, match="pilots"):
        Layout(4, 4, 64, 48, (), code=PilotCode())
    assert make_layout(4, 4, pilots=0, code=PilotCode()).code == PLAIN


def test_states_come_in_the_order_of_the_code() -> None:
    """All of a display's states come again after those of the loop and the code both."""
    loop, plain = (
        coded_loop(CODED, 2),
        coded_loop(make_layout(4, 4, modulation="antipodal", pilots=4), 2),
    )
    shown, usual = LoopStates(loop), LoopStates(plain)
    assert (len(shown), len(usual)) == (2 * 14, 4)
    for pair, sign in enumerate(np.tile(CODED.code.signs, 2)):
        original, embedded = (usual[2 * (pair % 2) + which] for which in (0, 1))
        first, second = (original, embedded) if sign > 0 else (embedded, original)
        assert (shown[2 * pair] == first).all()
        assert (shown[2 * pair + 1] == second).all()


def test_a_file_shows_the_whole_code() -> None:
    loop = coded_loop(CODED, 3)
    states = list(loop.states())
    assert len(states) == 2 * 21  # loops of three pairs end with a code of seven after 21
    running = LoopStates(loop)
    assert all((state == running[number]).all() for number, state in enumerate(states))
