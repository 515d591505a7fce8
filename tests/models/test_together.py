"""Several captures of one displayed frame pair in one fit."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from link.embed import embed
from link.errors import InputError
from link.frames import Rectified, combined
from link.layout import Layout, make_layout
from models import PRETRAINED, PRETRAINED_PILOTS
from models.neural.checkpoint import load_checkpoint
from models.neural.config import DecoderConfig
from models.neural.decoder import PhiDecoder
from models.neural.methods import Learned, decode_together, decode_with
from models.neural.refine import MOMENTS
from models.neural.refine_pilots import STATISTICS, PilotRefiner
from models.neural.refine_ratex import RatexRefiner

RATEX = make_layout(6, 8, 256, 192, 2)
PILOTS = make_layout(6, 8, 256, 192, modulation="antipodal", pilots="auto")
both_kinds = pytest.mark.parametrize("layout", [RATEX, PILOTS], ids=["ratex", "pilots"])


def decoder_of(layout: Layout) -> PhiDecoder:
    return load_checkpoint(PRETRAINED_PILOTS if layout.pilots else PRETRAINED, layout).eval()


def captures_of(
    layout: Layout, count: int, noise: float
) -> tuple[list[Rectified], NDArray[np.intp]]:
    """One displayed frame pair as cameras of other exposure and gamma see it, with own noise."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[: layout.height, : layout.width]
    picture = (128 + 60 * np.sin(x / 40)[..., None] * np.cos(y / 30)[..., None]).repeat(3, axis=2)
    bits = rng.integers(0, 2, layout.n_bits)
    shown = embed(picture.astype(np.uint8), bits, layout, kappa=2)
    captures = []
    for _ in range(count):
        gain, gamma = rng.uniform(0.7, 1.0), rng.uniform(0.8, 1.2)
        frames = []
        for frame, drift in ((shown.original, 1.0), (shown.embedded, rng.uniform(0.98, 1.02))):
            light = 255 * gain * drift * (frame / 255) ** gamma
            noisy = light + noise * rng.standard_normal(frame.shape)
            frames.append(noisy.round().clip(0, 255).astype(np.uint8))
        captures.append(Rectified(frames[0], frames[1], layout, 2))
    return captures, bits


@both_kinds
def test_one_capture_is_decoded_as_it_is_alone(layout: Layout) -> None:
    (capture,), _ = captures_of(layout, 1, noise=10.0)
    decoder = decoder_of(layout)
    alone, together = decode_with(decoder, capture), decode_together(decoder, [capture])
    np.testing.assert_array_equal(together.scores, alone.scores)
    np.testing.assert_array_equal(Learned().decode_together([capture]).scores, alone.scores)
    assert together.head is None


@both_kinds
def test_captures_that_are_too_noisy_alone_are_read_together(layout: Layout) -> None:
    captures, bits = captures_of(layout, 8, noise=60.0 if layout.pilots else 30.0)
    decoder = decoder_of(layout)
    wrong = [int((decode_with(decoder, each).bits != bits).sum()) for each in captures]
    together = decode_together(decoder, captures)
    assert (together.bits != bits).sum() < min(wrong)


@both_kinds
def test_the_order_of_captures_does_not_matter(layout: Layout) -> None:
    captures, _ = captures_of(layout, 3, noise=20.0)
    decoder = decoder_of(layout)
    forth, back = (decode_together(decoder, each) for each in (captures, captures[::-1]))
    np.testing.assert_allclose(forth.scores, back.scores, rtol=0, atol=1e-3)


def test_without_refinement_scores_are_added() -> None:
    captures, _ = captures_of(RATEX, 3, noise=5.0)
    decoder = PhiDecoder(RATEX, DecoderConfig()).eval()
    added = combined([decode_with(decoder, each) for each in captures])
    together = decode_together(decoder, captures)
    np.testing.assert_allclose(together.scores, added.scores, rtol=1e-4, atol=1e-4)


def test_patches_are_refined_from_the_sum_of_all_first_scores() -> None:
    rng = np.random.default_rng(0)
    refiner = RatexRefiner(RATEX, 1, True, True)
    tiles, blocks = (
        torch.from_numpy(rng.uniform(-0.3, 0.3, (3, count, 1 + MOMENTS)))
        for count in (len(refiner.levels), RATEX.n_bits)
    )
    scores = torch.from_numpy(rng.normal(0, 0.2, (3, RATEX.n_bits)))
    with torch.no_grad():
        together = refiner(tiles, blocks, scores, together=True)
        alone = refiner(tiles, blocks, scores.sum(0).expand(3, -1))
    torch.testing.assert_close(together, alone, rtol=1e-6, atol=1e-6)


def test_pilots_are_refined_alone_until_the_first_scores_are_there() -> None:
    """Without a round over all blocks, captures have shared nothing yet; with one, they have."""
    rng = np.random.default_rng(0)
    drawn = torch.from_numpy(rng.uniform(-0.3, 0.3, (3, PILOTS.message_mask.size, STATISTICS)))
    drawn[..., -2:] = drawn[..., -2:].abs() + 0.1
    given = drawn[:, : PILOTS.pilots], drawn[:, PILOTS.pilots :]
    for rounds, shared in ((0, False), (1, True)):
        refiner = PilotRefiner(PILOTS, 768.0, rounds=rounds, rows=True, space=True)
        with torch.no_grad():
            alone, together = refiner(*given), refiner(*given, together=True)
        assert torch.equal(alone, together) != shared


def test_captures_that_do_not_belong_together_are_refused() -> None:
    (capture,), _ = captures_of(RATEX, 1, noise=0.0)
    other = replace(capture, layout=make_layout(6, 8, 256, 192, 1))
    for captures in ([], [capture, other]):
        with pytest.raises(InputError, match="captures of one frame pair must"):
            Learned().decode_together(captures)
