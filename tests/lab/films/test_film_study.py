"""The comparison of frame pairs and windows of film."""

from dataclasses import replace

from lab.films.film import METHODS, FilmContent, Reading, film_blocks
from lab.study import Results
from reports.score.reliability import Bin


def test_what_frame_pairs_do_not_read_has_dashes() -> None:
    sure = [Bin(low=0.9, high=0.95, count=10, correct=9, confidence=0.92, ci_low=0.6, ci_high=1.0)]
    readings = [
        Reading("hidden, 30 fps", method, "canon-lg", 0.0, 0, "a", 10, 1, sure)
        for method in METHODS
    ]
    readings[1] = replace(readings[1], bins=[])
    tables = film_blocks({"": Results({}, FilmContent(readings))})
    told, errors = (
        [cell.strip() for cell in tables[name].splitlines()[-1].strip("|").split("|")]
        for name in ("film", "film_errors")
    )
    assert told[2:] == ["1", "0.531", "0.000", "0.531", "0.531", "0.531", "–", "– – –"]
    assert errors[2:] == 5 * ["10.00"] + ["0.020", "–", "0.020", "0.020", "0.020"]
