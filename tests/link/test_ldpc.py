"""The code against its parity-check matrix and against maximum likelihood by enumeration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from link.code.ldpc import Code, make_code
from link.code.scrambled import scrambled


def parity_check_matrix(code: Code) -> NDArray[np.int64]:
    H = np.zeros((code.parity, code.length), np.float32)
    np.add.at(H, (code.check, code.bit), 1)
    return H


def test_scrambled_words_are_those_of_splitmix64() -> None:
    # first outputs of the reference implementation (Vigna, splitmix64.c) from state 0
    words = scrambled(np.array([0]), 0)
    assert int(words[0]) == 0xE220A8397B1DCDAF
    assert int(scrambled(np.array([0]), 1)[0]) == 0x6E789E6AA1B965F4


@pytest.mark.parametrize("size", [(72, 81), (400, 416), (864, 870)])
def test_graph_has_no_double_edge_and_no_short_cycle(size: tuple[int, int]) -> None:
    H = parity_check_matrix(make_code(*size))
    assert H.max() == 1
    assert H.sum(axis=0)[: size[0]].min() >= 2
    shared = H.T @ H
    np.fill_diagonal(shared, 0)
    cycles = (shared > 1).sum() / 2
    assert cycles <= (0 if size[0] > 300 else 40)


@settings(max_examples=25, deadline=None)
@given(st.integers(8, 200), st.integers(0, 2**32 - 1))
def test_encoded_words_satisfy_every_check(information: int, seed: int) -> None:
    code = make_code(information, information + 3)
    bits = np.random.default_rng(seed).integers(0, 2, information)
    word = code.encode(bits)
    assert np.array_equal(word[:information], bits)
    assert not (parity_check_matrix(code) @ word % 2).any()
    assert code.unsatisfied(word) == 0
    word[seed % word.size] ^= 1
    assert code.unsatisfied(word) > 0


def test_decoding_is_close_to_maximum_likelihood_by_enumeration() -> None:
    code = make_code(10, 14)
    words = np.array([code.encode(np.array(list(f"{n:010b}"), np.int64)) for n in range(1024)])
    rng = np.random.default_rng(3)
    same = decoded = 0
    for _ in range(200):
        sent = words[rng.integers(1024)]
        llr = 2.0 * (2 * sent - 1.0) + 2 * rng.standard_normal(code.length)
        best = words[np.argmax((words - 0.5) @ llr)]
        found = code.decode(llr)
        if found is not None:
            assert code.unsatisfied(found) == 0
            decoded += 1
            same += np.array_equal(found, best)
    assert decoded > 100
    assert same >= 0.93 * decoded


def test_erased_bits_are_filled_in() -> None:
    code = make_code(400, 416)
    rng = np.random.default_rng(0)
    word = code.encode(rng.integers(0, 2, 400))
    llr = 8.0 * (2.0 * word - 1)
    llr[rng.permutation(code.length)[:300]] = 0
    found = code.decode(llr)
    assert np.array_equal(found, word)


def test_values_that_are_not_finite_count_as_erased_or_certain() -> None:
    code = make_code(72, 81)
    word = code.encode(np.ones(72, np.int64))
    llr = 8.0 * (2.0 * word - 1)
    llr[3], llr[5] = np.nan, np.inf * llr[5]
    found = code.decode(llr)
    assert np.array_equal(found, word)
