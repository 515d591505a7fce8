from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from conftest import cases

from data_gen import frame_pair
from data_gen.effects import switch_off, with_parameter
from data_gen.episodes import EpisodePlan, EpisodeSet, simulate_episodes
from data_gen.frame_pair import Cell, FramePair, Source, shuffled_pictures
from data_gen.pairs import PAIRS
from data_gen.parameters import Pair
from link.frames import Captured
from link.layout import Layout, make_layout
from link.types import Image
from reports.engine.backends import Backend, run_tasks

FRONTAL = Cell("canon-lg", 0.0, 5)
OBLIQUE = Cell("sony-samsung", 45.0, 3)
PLAN = EpisodePlan(count=3, kappas=(2, 5), max_view=30.0)
SMALL = make_layout(4, 4, 256, 192, 2)


def same(a: Captured, b: Captured) -> bool:
    return (
        np.array_equal(a.original, b.original)
        and np.array_equal(a.embedded, b.embedded)
        and np.array_equal(a.corners, b.corners)
        and np.array_equal(a.bits, b.bits)
        and a.meta == b.meta
    )


# Cells


def filmed(source: Source, cell: Cell, index: int) -> Captured:
    return FramePair(source, cell, index).captured


def test_cells_do_not_depend_on_the_order(layout: Layout) -> None:
    source = Source(layout)
    there = [filmed(source, cell, index) for cell in (FRONTAL, OBLIQUE) for index in (0, 1)]
    back = [filmed(source, cell, index) for cell in (OBLIQUE, FRONTAL) for index in (1, 0)]
    assert all(same(a, b) for a, b in zip(there, reversed(back), strict=True))


@cases(
    (Source(SMALL, seed=1), FRONTAL, 0),
    (Source(SMALL, split="train"), FRONTAL, 0),
    (Source(SMALL), replace(FRONTAL, pair="canon-imac"), 0),
    (Source(SMALL), replace(FRONTAL, view_deg=1.0), 0),
    (Source(SMALL), replace(FRONTAL, kappa=4), 0),
    (Source(SMALL), FRONTAL, 1),
    ids=["seed", "split", "pair", "view", "kappa", "index"],
)
def test_everything_that_names_a_frame_pair_changes_its_draw(
    source: Source, cell: Cell, index: int
) -> None:
    usual, other = FramePair(Source(SMALL), FRONTAL, 0), FramePair(source, cell, index)
    assert not np.array_equal(usual.displayed.bits, other.displayed.bits)
    assert not np.array_equal(usual.captured.corners, other.captured.corners)


def test_a_frame_pair_is_drawn_and_filmed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []

    def counted(name: str) -> None:
        inner = getattr(frame_pair, name)
        monkeypatch.setattr(
            frame_pair, name, lambda *a, **more: [calls.append(name), inner(*a, **more)][1]
        )

    for name in ("embed", "capture"):
        counted(name)
    pair = FramePair(Source(SMALL), OBLIQUE, 0)
    assert calls == []  # nothing is made before it is asked for
    for _ in range(2):
        assert pair.rectified is pair.rectified
        assert pair.captured.bits is pair.displayed.bits
    assert calls == ["embed", "capture"]


def test_message_bits_are_balanced() -> None:
    source = Source(SMALL)
    bits = np.array([FramePair(source, FRONTAL, index).displayed.bits for index in range(100)])
    assert set(np.unique(bits)) == {0, 1}
    assert abs(bits.mean() - 0.5) < 0.05  # 1400 bits: 3.7 standard errors


@pytest.mark.slow
def test_the_hidden_variant_shares_the_pose_and_the_picture(layout: Layout) -> None:
    for index in range(3):
        plain = FramePair(Source(layout), OBLIQUE, index).captured
        hidden = FramePair(Source(layout), OBLIQUE, index, equalised=True).captured
        assert np.array_equal(plain.corners, hidden.corners)
        assert {**plain.meta, "equalised": True} == hidden.meta
        assert (plain.layout.n_bits, hidden.layout.n_bits) == (59, 64)
        assert hidden.layout.ratex == ()
        assert not np.array_equal(plain.original, hidden.original)


def test_captures_say_where_they_come_from(captured: Captured) -> None:
    assert captured.kappa == 5
    assert captured.meta == {
        "pair": "canon-lg",
        "view_deg": 45.0,
        "picture": shuffled_pictures(Source(captured.layout))[0].name,
        "seed": 0,
        "simulated": True,
        "split": "test",
        "equalised": False,
    }


# The channel of a source


def test_effects_switched_off_and_parameters_set_are_those_of_the_pair() -> None:
    source = Source(SMALL, without=("noise", "moire"), parameters=(("drift", 0.3),))
    expected = with_parameter(switch_off(PAIRS["canon-lg"], ["noise", "moire"]), "drift", 0.3)
    assert source.pair("canon-lg") == expected
    assert Source(SMALL).pair("canon-lg") == PAIRS["canon-lg"]


def test_parameters_are_set_after_effects_are_switched_off() -> None:
    source = Source(SMALL, without=("noise",), parameters=(("noise_scale", 2.0),))
    assert source.pair("canon-lg").frontal.noise_scale == 2.0


@cases(
    Source(SMALL, without=("noise",)),
    Source(SMALL, parameters=(("jpeg_quality", 60),)),
    ids=["without", "parameters"],
)
def test_a_changed_channel_keeps_the_draws_and_changes_the_frames(other: Source) -> None:
    usual, changed = (filmed(source, FRONTAL, 0) for source in (Source(SMALL), other))
    assert not np.array_equal(usual.embedded, changed.embedded)
    assert np.array_equal(usual.bits, changed.bits)
    assert np.array_equal(usual.corners, changed.corners)


# Pictures of a source


@pytest.mark.parametrize("split", ["train", "test"])
def test_the_first_pictures_mix_photographs_and_drawings(split: str) -> None:
    first = [picture.name for picture in shuffled_pictures(Source(SMALL, split))[:6]]
    assert 2 <= sum(name.startswith("photo/") for name in first) <= 5


def test_the_index_wraps_around_the_pictures_with_a_new_message() -> None:
    source = Source(SMALL)
    pictures = shuffled_pictures(source)
    first, again = FramePair(source, FRONTAL, 2), FramePair(source, FRONTAL, 2 + len(pictures))
    assert first.picture.name == again.picture.name == pictures[2].name
    assert np.array_equal(first.displayed.original, again.displayed.original)
    assert not np.array_equal(first.displayed.bits, again.displayed.bits)


def test_the_users_pictures_replace_the_built_in_ones(tmp_path: Path) -> None:
    for name in ("b.png", "a.png"):
        assert cv2.imwrite(str(tmp_path / name), np.full((192, 256, 3), 90, np.uint8))
    source = Source(SMALL, pictures=tmp_path)
    names = [FramePair(source, FRONTAL, index).picture.name for index in range(3)]
    assert names == ["a.png", "b.png", "a.png"]


# Episodes


@pytest.fixture(scope="module")
def episodes() -> EpisodeSet:
    return simulate_episodes(Source(SMALL, "train"), ("canon-lg", "nikon-imac"), PLAN, 1)


def equal(a: EpisodeSet, b: EpisodeSet) -> bool:
    pairs = ((a.original, b.original), (a.embedded, b.embedded), (a.bits, b.bits))
    return all(torch.equal(x, y) for x, y in pairs)


def test_episodes_are_batches_of_rectified_frames(episodes: EpisodeSet) -> None:
    assert episodes.original.shape == episodes.embedded.shape == (3, 3, 192, 256)
    assert episodes.original.dtype == episodes.embedded.dtype == torch.uint8
    assert episodes.bits.shape == (3, SMALL.n_bits)
    assert episodes.bits.dtype == torch.int64
    assert sorted(set(episodes.bits.flatten().tolist())) == [0, 1]
    assert not torch.equal(episodes.original, episodes.embedded)


@pytest.mark.slow
def test_episodes_do_not_depend_on_the_number_of_jobs(episodes: EpisodeSet) -> None:
    list(run_tasks(abs, [1, 2], Backend(2)))  # opens processes, as a run earlier in this one does
    again = simulate_episodes(Source(SMALL, "train"), ("canon-lg", "nikon-imac"), PLAN, 2)
    assert equal(episodes, again)


def test_views_and_kappas_of_the_episodes_follow_the_plan(monkeypatch: pytest.MonkeyPatch) -> None:
    cells: list[Cell] = []

    def note(source: Source, cell: Cell, index: int) -> tuple[np.ndarray, ...]:
        cells.append(cell)
        return np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1, 3), np.uint8), np.zeros(1, int)

    monkeypatch.setattr("data_gen.episodes._rectified", note)
    simulate_episodes(Source(SMALL, "train"), list(PAIRS), EpisodePlan(180, (2, 5), 30.0), 1)
    assert [cell.pair for cell in cells[:9]] == list(PAIRS)
    assert {cell.kappa for cell in cells} == {2, 5}
    views = np.array([cell.view_deg for cell in cells])
    assert 0 <= views.min() < 3
    assert 27 < views.max() <= 30


def test_episodes_vary_the_channel_except_what_the_source_sets(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    channels: list[Pair] = []

    def note(source: Source, cell: Cell, index: int) -> tuple[Image, ...]:
        channels.append(source.pair(cell.pair))
        return np.zeros((1, 1, 3), np.uint8), np.zeros((1, 1, 3), np.uint8), np.zeros(1, np.uint8)

    monkeypatch.setattr("data_gen.episodes._rectified", note)
    source = Source(SMALL, "train", parameters=(("drift", 0.5),))
    simulate_episodes(source, ["canon-lg"], EpisodePlan(20, (2, 5), 30.0), 1)
    assert len({pair.setup.metering for pair in channels}) == 20
    assert {pair.frontal.drift for pair in channels} == {0.5}
