"""The page turns scores into bits, bits into words, and codewords into messages as Python does."""

import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from web_fixtures import run_node_tests, write_fixture

from link.code.fine import Shape, Terms, coded_bits, mark_of, number_likelihoods, read_terms
from link.code.framing import code_of, decode, encode, parity_mask, signatures
from link.code.ldpc import make_code, scrambled
from link.code.message import Message
from link.code.rateless import make_rateless
from link.code.words import weigh_words


def noisy(bits: NDArray[np.integer], ber: float, rng: np.random.Generator) -> NDArray[np.float32]:
    """Log-likelihood ratios of a binary symmetric channel, some of them erased."""
    signs = (2.0 * bits - 1) * np.where(rng.random(bits.shape) < ber, -1, 1)
    scores = np.log((1 - ber) / ber) * signs * (rng.random(bits.shape) > 0.2)
    return np.asarray(scores, np.float32)


def test_numbers_and_texts(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    numbers = np.concatenate([np.arange(50), rng.integers(0, 2**32, 50)])
    texts = [
        "Grüße, 你好 🙂".encode(),
        b"\xef\xbb\xbfmark",
        bytes(range(256)),
        "🙂".encode()[:3] + b"A",
        b"\xed\xa0\x80 \xc0\xaf \xf4\x90\x80\x80 \xe2\x82",
        *(rng.bytes(60) for _ in range(5)),
        *(
            bytes(rng.choice([0x41, 0x80, 0xBF, 0xC3, 0xE2, 0xED, 0xF0, 0xF4], 60))
            for _ in range(9)
        ),
    ]
    fixture = {
        "numbers": numbers.astype(float),
        "words": [
            {
                "seed": seed,
                "words": [f"{word:016x}" for word in scrambled(numbers, seed).tolist()],
                "order": np.argsort(scrambled(np.arange(3000), seed), kind="stable"),
            }
            for seed in (0, 13, 1005, 2**24 - 1)
        ],
        "texts": [
            {
                "data": np.frombuffer(data, np.uint8),
                "text": Message(data, 1, 1, 1.0).text,
                "crc": zlib.crc32(data),
                "mark": mark_of(data),
            }
            for data in texts
        ],
    }
    write_fixture(tmp_path, "numbers", fixture)
    run_node_tests("codeNumbers", tmp_path)


def test_coarse_grids(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    codes = []
    for information, parity in ((8, 9), (72, 81), (400, 416)):
        code = make_code(information, parity)
        bits = rng.integers(0, 2, information)
        codes.append(
            {
                "information": information,
                "parity": parity,
                "bit": code.bit,
                "starts": code.starts,
                "bits": bits.astype(np.uint8),
                "codeword": code.encode(bits),
            }
        )
    code = code_of(9, 59)
    words = []
    for ber in (0.001, 0.02, 0.05, 0.08, 0.3):
        bits = code.encode(rng.integers(0, 2, code.information))
        llr = noisy(bits, ber, rng).astype(float)
        llr[:4] = [np.nan, *np.copysign([np.inf, np.inf, 1e300], bits[1:4] - 0.5)]
        words.append({"llr": llr, "codeword": code.decode(llr)})
    assert {word["codeword"] is None for word in words} == {True, False}
    loops = []
    for n_bytes, n_bits in ((1, 16), (5, 59), (40, 59), (30, 251)):
        message = rng.bytes(n_bytes)
        bits = encode(message, n_bits)
        read = {}
        for ber in (0.001, 0.03, 0.3):
            scores = noisy(bits, ber, rng).astype(float)
            read[str(ber)] = {"scores": scores, "message": as_bytes(decode(scores))}
        loops.append(
            {
                "message": as_bytes(message),
                "n_bits": n_bits,
                "bits": bits,
                "signatures": signatures(len(bits)),
                "parity": parity_mask(len(bits), n_bits),
                "read": list(read.values()),
            }
        )
    write_fixture(tmp_path, "coarse", {"codes": codes, "words": words, "loops": loops})
    run_node_tests("codeCoarse", tmp_path)


def as_bytes(data: bytes | None) -> NDArray[np.uint8] | None:
    return None if data is None else np.frombuffer(data, np.uint8)


def test_fine_grids(tmp_path: Path) -> None:
    rng = np.random.default_rng(2)
    grids = []
    for n_bits in (512, 730, 2918, 11674):
        shape = Shape.of(n_bits)
        scores = rng.normal(0, 4, n_bits).astype(np.float32)
        grids.append(
            {
                "n_bits": n_bits,
                "shown": shape.shown,
                "head": shape.head,
                "rest": shape.rest,
                "pieces": shape.pieces_shown(5),
                "whitening": shape.whitening(4095),
                "scores": scores,
                "likelihoods": number_likelihoods(scores),
            }
        )
    told = []
    for n_bytes, frames, mark in ((1, 8, 0), (700, 17, 0xABCDEF), (2**20, 1440, 77), (9, 4096, 5)):
        terms = Terms(n_bytes, frames, mark)
        pieces = terms.pieces()
        wrong = pieces.copy()
        wrong[rng.integers(6)] ^= 1 << rng.integers(12)
        told.append(
            {
                "terms": [n_bytes, frames, mark],
                "pieces": pieces,
                "wrong": wrong,
                "blocks": terms.blocks,
                "block_bytes": terms.block_bytes,
                "possible": [read_terms(pieces, n_bits) is not None for n_bits in (512, 11674)],
            }
        )
        assert all(read_terms(wrong, n_bits) is None for n_bits in (512, 11674))
    word = rng.normal(0, 3, 48).astype(np.float32)
    codes = [make_rateless(information) for information in (256, 5616, 16384)]
    message = rng.bytes(2500)
    terms = Terms(len(message), 9, mark_of(message))
    fixture = {
        "grids": grids,
        "told": told,
        "word": {"scores": word, "weights": weigh_words(word[None])[0]},
        "codes": [
            {
                "information": code.information,
                "intermediate": code.intermediate,
                "precode": code.precode.T,
            }
            for code in codes
        ],
        "message": as_bytes(message),
        "n_bits": 2918,
        "coded": coded_bits(message, terms, 2918),
        "terms": [terms.n_bytes, terms.frames, terms.mark],
    }
    write_fixture(tmp_path, "fine", fixture)
    run_node_tests("codeFine", tmp_path)


def test_information_is_found_where_python_finds_it(tmp_path: Path) -> None:
    """Little, enough and much of the information was received, by every kind of channel."""
    rng = np.random.default_rng(3)
    code = make_rateless(512)
    cases = []
    for blocks, count, ber in ((1, 900, 0.001), (3, 900, 0.02), (2, 620, 0.02), (18, 2600, 0.1)):
        information = rng.integers(0, 2, (512, blocks), np.uint8)
        llr = noisy(code.encode(information, count), ber, rng)
        bits, done = code.decode(llr)
        assert np.array_equal(bits[:, done], information[:, done])
        found = bits.T if done.all() else None
        cases.append({"llr": llr, "blocks": blocks, "information": found})
    assert {case["information"] is None for case in cases} == {True, False}
    write_fixture(tmp_path, "rateless", {"information": 512, "cases": cases})
    run_node_tests("codeRateless", tmp_path)
