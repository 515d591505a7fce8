"""The table of displays' sizes."""

import numpy as np

from lab.films.sizes import SizesContent, SizeSeries, SizesFlags, check_sizes, sizes_blocks
from lab.films.trial import Delivery
from lab.study import Results
from reports.score.reliability import binned_information, confidence_bins


def test_films_can_be_run_at_the_usual_sizes() -> None:
    flags = SizesFlags()
    check_sizes(flags)
    film = flags.film("hidden", (1080, 1920), None)
    assert (film.fps, film.display_size) == (120, (1080, 1920))
    assert film.name(0) != flags.film("hidden", (1080, 1920), True).name(0)


def test_the_table_counts_films_and_weighs_erased_bits_as_nothing() -> None:
    bins = confidence_bins(np.full(50, 9.0), np.ones(50, int))

    def run(seconds: float, delivered: bool) -> Delivery:
        times = (1.0, seconds, 9, 9, 100, 5, 4, 30.0)
        return Delivery("canon-lg", 0.0, 0, "a", delivered, False, *times, bins)

    runs = [run(2.0, True), run(4.0, True), run(5.0, False)]
    series = SizeSeries("hidden", (1080, 1920), True, 45.0, runs)
    table = sizes_blocks({"one": Results({}, SizesContent([series]))})["sizes"].splitlines()
    heads, row = ([cell.strip() for cell in table[line].split("|")] for line in (2, 4))
    cells = dict(zip(heads, row, strict=True))
    assert (cells["display"], cells["strength"], cells["read"]) == ("1080 × 1920", "even", "2 of 3")
    assert (cells["seconds, median"], cells["longest"]) == ("3.00", "4.00")
    assert cells["bits wrong %, median film"] == "5.00"
    assert cells["information, bits a block and pair"] == "0.500"


def test_information_is_the_capacity_of_the_bins() -> None:
    rng = np.random.default_rng(0)
    bits = rng.integers(0, 2, 40_000)
    score = np.log(0.9 / 0.1)
    right = rng.random(bits.size) < 0.9
    scores = np.where(right, 2 * bits - 1, 1 - 2 * bits) * score
    entropy = -0.9 * np.log2(0.9) - 0.1 * np.log2(0.1)
    assert abs(binned_information(confidence_bins(scores, bits), bits.size) - (1 - entropy)) < 0.01
    assert binned_information([], 9) == 0
