"""The comparison of frame pairs and windows of film."""

from lab.films.film import METHODS, FilmContent, Reading, film_blocks
from lab.study import Results
from reports.score.reliability import Bin


def test_what_frame_pairs_do_not_read_has_dashes() -> None:
    sure = [Bin(low=0.9, high=0.95, count=10, correct=9, confidence=0.92, ci_low=0.6, ci_high=1.0)]
    pairs, film = (
        Reading("hidden, 30 fps", method, "canon-lg", 0.0, 0, "a", 10, 1, bins)
        for method, bins in zip(METHODS, ([], sure), strict=True)
    )
    table = film_blocks({"": Results({}, FilmContent([pairs, film]))})["film"]
    cells = [cell.strip() for cell in table.splitlines()[-1].strip("|").split("|")]
    assert cells[6:] == ["0.531", "–", "– – –", "–", "0.020"]
