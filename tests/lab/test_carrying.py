"""What a picture carries by its gray level: the patches, the table, and one film."""

import numpy as np
import pytest

from lab.carrying import (
    LEVELS,
    CarryingContent,
    PatchFilm,
    Told,
    carrying_blocks,
    patch_picture,
    read_patches,
)
from lab.study import Results
from link.presets import PRESETS
from sender.carrying import CARRIED


@pytest.mark.parametrize("preset", CARRIED)
def test_each_level_has_equally_many_blocks(preset: str) -> None:
    layout = PRESETS[preset].layout
    levels = patch_picture(layout, np.random.default_rng(0))
    assert levels.shape == (layout.rows, layout.cols)
    found, counts = np.unique(levels, return_counts=True)
    assert tuple(found) == LEVELS and len(set(counts)) == 1


def test_the_table_is_of_the_films_that_were_found() -> None:
    films = [Told("fast", 9, [share] * len(LEVELS)) for share in (0.5, 0.7, 0.6)]
    stored = Results({}, CarryingContent([*films, Told("fast", 0, []), Told("robust", 0, [])]))
    table = carrying_blocks({"carrying": stored})["carrying"].splitlines()
    fast, robust = "fast: 27 frame pairs of 3 in 4 films", "robust: 0 frame pairs of 0 in 1 films"
    assert table[2] == f"| gray level | {fast} | {robust} |"
    assert table[4:] == [f"| {level} | 0.60 ± 0.25 | – |" for level in LEVELS]


@pytest.mark.slow
def test_a_bright_patch_carries_more_than_black() -> None:
    told = read_patches(PatchFilm("fast", "canon-lg", 1, 0.6, 0))
    assert told.pairs > 0
    assert told.shares[0] < told.shares[-1] <= 1
