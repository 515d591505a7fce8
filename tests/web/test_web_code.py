"""The page turns scores into bits, bits into words, and codewords into messages as Python does."""

import zlib

import numpy as np
import pytest
from conftest import cases
from numpy.typing import NDArray
from port import Port, same
from scores import noisy
from tolerances import FLOAT32_SUM

from link.code.fine import Shape, Terms, coded_bits, mark_of, number_likelihoods, read_terms
from link.code.framing import encode
from link.code.ldpc import make_code
from link.code.message import Content, Message
from link.code.rateless import make_rateless
from link.code.scrambled import scrambled
from link.code.words import weigh_words
from link.steps import run_to_end
from link.types import Floats


def partly(bits: NDArray[np.integer], ber: float, rng: np.random.Generator) -> Floats:
    """Scores of a binary symmetric channel, some of them erased."""
    return np.asarray(noisy(bits, ber, rng) * (rng.random(bits.shape) > 0.2), np.float32)


@pytest.mark.parametrize("seed", [0, 13, 1005, 2**24 - 1])
def test_numbers_are_scrambled(port: Port, seed: int) -> None:
    drawn = np.random.default_rng(0).integers(0, 2**32, 50)
    numbers, ported = np.concatenate([np.arange(50), drawn]), port("link/code/scrambled.js")
    found = ported.scrambled(numbers.astype(np.uint32), seed)
    words = [int(high) << 32 | int(low) for high, low in zip(found.high, found.low, strict=True)]
    assert words == scrambled(numbers, seed).tolist()
    order = np.argsort(scrambled(np.arange(3000), seed), kind="stable")
    same(ported.shuffled(3000, seed), order)


RNG = np.random.default_rng(0)
TEXTS = [
    b"plain",
    "Grüße, 你好 🙂".encode(),
    b"\xef\xbb\xbfmark",
    bytes(range(256)),
    "🙂".encode()[:3] + b"A",
    b"\xff\x00a",
    b"a\xc3",
    b"\xf0\x9f\x98",
    b"\xed\xa0\x80 \xc0\xaf \xf4\x90\x80\x80 \xe2\x82",
    *(RNG.bytes(60) for _ in range(5)),
    *(bytes(RNG.choice([0x41, 0x80, 0xBF, 0xC3, 0xE2, 0xED, 0xF0, 0xF4], 60)) for _ in range(9)),
]


@pytest.mark.parametrize("data", TEXTS, ids=range(len(TEXTS)))
def test_texts_and_their_sums(port: Port, data: bytes) -> None:
    crc32, bits = port("link/code/crc.js").crc32, port("link/code/bits.js")
    assert crc32(data) == crc32(data[3:], crc32(data[:3])) == zlib.crc32(data)
    assert port("link/code/fine.js").markOf(data) == mark_of(data)
    assert port("link/code/message.js").textOf(data) == Message(data, 1, 1, 1.0).text
    same(bits.unpackBits(data), np.unpackbits(np.frombuffer(data, np.uint8)))
    assert bytes(bits.packBits(bits.unpackBits(data))) == data


@cases((8, 9), (72, 81), (400, 416))
def test_graphs_and_codewords(information: int, parity: int, port: Port) -> None:
    code = make_code(information, parity)
    ported = port("link/code/ldpc.js").makeCode(information, parity)
    bits = np.random.default_rng(1).integers(0, 2, information).astype(np.uint8)
    same(ported.checks.members, code.bit)
    same(ported.checks.starts, [*code.starts, len(code.bit)])
    same(ported.encode(bits), code.encode(bits))


@pytest.mark.parametrize("n_bits", [512, 730, 2918, 11674])
def test_shapes_and_frames_of_fine_grids(port: Port, n_bits: int) -> None:
    scores = np.random.default_rng(2).normal(0, 4, n_bits).astype(np.float32)
    shape, module = Shape.of(n_bits), port("link/code/fine.js")
    ported = module.Shape.of(n_bits)
    assert ported.shown == shape.shown
    same(ported.head, shape.head)
    same(ported.rest, shape.rest)
    same(ported.piecesShown(5), shape.pieces_shown(5))
    white = shape.whitening(4095)
    same(ported.whitening(4095) & 1, white)
    same(module.numberLikelihoods(scores), number_likelihoods(scores), FLOAT32_SUM)
    coded = np.where(white, -scores, scores)[shape.rest]
    same(module.ReadFrame(scores, 4095).coded, coded)


@pytest.mark.parametrize(
    "values", [(1, 8, 0), (700, 17, 0xABCDEF), (2**20, 1440, 77), (9, 4096, 5)], ids=str
)
def test_terms(port: Port, values: tuple[int, int, int]) -> None:
    rng, module = np.random.default_rng(2), port("link/code/fine.js")
    terms, ported = Terms(*values), module.Terms(*values)
    pieces = terms.pieces()
    wrong = pieces.copy()
    wrong[rng.integers(6)] ^= 1 << rng.integers(12)
    same(ported.pieces(), pieces)
    assert (ported.blocks, ported.blockBytes) == (terms.blocks, terms.block_bytes)
    for n_bits in (512, 11674):
        found, known = module.readTerms(pieces.tolist(), n_bits), read_terms(pieces, n_bits)
        read = found and (found.nBytes, found.frames, found.mark)
        assert read == (known and values)
        assert module.readTerms(wrong.tolist(), n_bits) is read_terms(wrong, n_bits) is None


COARSE = (1, 16), (5, 59), (40, 59), (30, 251)
FINE = (1, 512), (100, 730), (3000, 730), (5000, 2918), (70_000, 11674)


@cases(*COARSE, *FINE)
def test_loops(n_bytes: int, n_bits: int, port: Port) -> None:
    ported, signed = port("link/code/framing.js"), n_bytes in (30, 40, 100)
    message = np.random.default_rng(n_bytes).bytes(n_bytes)
    bits = encode(message, n_bits, signed=signed)
    assert ported.framesNeeded(n_bytes, n_bits) == len(bits)
    same(ported.encode({"data": message, "signed": signed}, n_bits), bits)


def test_words(port: Port) -> None:
    scores = np.random.default_rng(2).normal(0, 3, 48).astype(np.float32)
    same(port("link/code/words.js").weighWord(scores), weigh_words(scores[None])[0], FLOAT32_SUM)


@pytest.mark.parametrize("information", [256, 5616, 16384])
def test_graphs_of_rateless_codes(port: Port, information: int) -> None:
    code = make_rateless(information)
    ported = port("link/code/rateless.js").makeRateless(information)
    assert ported.intermediate == code.intermediate
    same(ported.precode.members, code.precode.T.reshape(-1))
    assert ported.precode.starts[1] == code.precode.shape[0]


def test_coded_bits_and_their_message(port: Port) -> None:
    module, message = port("link/code/fine.js"), np.random.default_rng(2).bytes(2500)
    terms = Terms(len(message), 9, mark_of(message))
    ported = module.Terms(terms.n_bytes, terms.frames, terms.mark)
    for signed in (False, True):
        coded = coded_bits(Content(message, signed), terms, 2918)
        same(module.codedBits({"data": message, "signed": signed}, ported, 2918), coded)
        scores = 8 * coded.reshape(-1).astype(np.float32) - 4
        found = run_to_end(iter(module.codedDecodingSteps(scores, ported)))
        assert (bytes(found.data), found.signed) == (message, signed)
    other_mark = module.Terms(terms.n_bytes, terms.frames, terms.mark ^ 1)
    wrong = {"data": b"\7" * len(message), "signed": False}
    other = 8 * module.codedBits(wrong, ported, 2918).astype(np.float32) - 4
    assert run_to_end(iter(module.codedDecodingSteps(scores, other_mark))) is None
    assert run_to_end(iter(module.codedDecodingSteps(other, ported))) is None


def test_information_is_found_where_python_finds_it(port: Port) -> None:
    """Little, enough and much of the information was received, by every kind of channel."""
    rng, code = np.random.default_rng(3), make_rateless(512)
    ported = port("link/code/rateless.js").makeRateless(512)
    is_found = set()
    for blocks, count, ber in ((1, 900, 0.001), (3, 900, 0.02), (2, 620, 0.02), (18, 2600, 0.1)):
        information = rng.integers(0, 2, (512, blocks), np.uint8)
        llr = partly(code.encode(information, count), ber, rng)
        bits, done = run_to_end(code.decoding_steps(llr))
        assert np.array_equal(bits[:, done], information[:, done])
        found = run_to_end(iter(ported.decodingSteps(llr.reshape(-1), blocks)))
        same(found, bits.T if done.all() else None)
        is_found.add(bool(done.all()))
    assert is_found == {True, False}


def test_information_is_found_where_bits_are_told_beyond_any_number(port: Port) -> None:
    """Each bit is coded some fifty times alone, and each time surely: exponentials overflow."""
    information = np.arange(256, dtype=np.uint8)[:, None] % 2
    llr = 40 * make_rateless(256).encode(information, 700_000).astype(np.float32) - 20
    ported = port("link/code/rateless.js").makeRateless(256)
    found = run_to_end(iter(ported.decodingSteps(llr.reshape(-1), 1)))
    same(found, information.T)
