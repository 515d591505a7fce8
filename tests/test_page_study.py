"""The study that sets the page's receiver beside Python's."""

import numpy as np
import pytest
from conftest import Command

from reports.films import page
from reports.films.page import Read, Y4mFile, page_table, stages_table


def read(data: bytes | None, time: float, **stages: float) -> Read:
    return Read(data, time, frames=10, seconds=0.5, stages=stages)


def films() -> list[dict[str, object]]:
    right = {"setting": "paper", "message": b"yes", "python": read(b"yes", 2.0, track=0.1)}
    return [
        right | {"page": read(b"yes", 3.0, track=0.2)},
        right | {"page": read(None, 9.0, track=0.2)},
        right | {"page": read(b"no!", 2.0, track=0.2)},
    ]


def test_what_did_not_come_and_what_is_wrong_count_apart() -> None:
    row = page_table(films()).markdown().splitlines()[-1]
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[:2] == ["paper", "3"]
    assert cells[2].startswith("3 (") and cells[3].startswith("1 (")
    assert cells[4] == "1"
    assert cells[7] == "1.25 (1.00 – 1.50)"
    assert cells[8:] == ["20", "20"]


def test_stages_are_given_a_frame() -> None:
    row = stages_table(films()).markdown().splitlines()[-1]
    assert row == "| paper | track | 10.00 | 20.00 | 2.0 |"


def test_a_film_is_written_as_the_page_reads_it(tmp_path) -> None:
    frame = np.arange(16 * 16, dtype=np.uint8).reshape(16, 16)
    with Y4mFile(tmp_path / "film.y4m", 30) as file:
        file.write(frame, 0.0)
        file.write(frame, 1 / 30)
    data = (tmp_path / "film.y4m").read_bytes()
    first, rest = data.split(b"\n", 1)
    assert first == b"YUV4MPEG2 W16 H16 F30000:1000 Ip Cmono"
    assert rest == b"FRAME XTIME=0.000000\n" + frame.tobytes() + (
        b"FRAME XTIME=0.033333\n" + frame.tobytes()
    )


@pytest.mark.parametrize(
    ("flags", "says"),
    [(["--films", "0"], "--films: need"), (["--settings", "x"], "unknown name in --settings 'x'")],
)
def test_a_wrong_flag_is_refused(flags: list[str], says: str, command: Command) -> None:
    done = command(page.main, *flags)
    assert (done.status, done.stderr.count("\n")) == (2, 1), done.stderr
    assert done.stderr.startswith(f"error: {says}")
