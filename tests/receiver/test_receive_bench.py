"""The receiver's speed is measured on a film of any preset, which it finds by itself."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Command, Refuses
from pilot_films import robust_film

import receiver.bench as bench_cli
from link.images import write_image


def test_a_film_without_a_display_gives_nothing_to_time(tmp_path: Path, refuses: Refuses) -> None:
    write_image(tmp_path / "film" / "a.png", np.full((60, 80, 3), 90, np.uint8))
    refuses("receiver.bench", "film", "no frame pair was decoded", began=True)


@pytest.mark.slow
def test_a_film_of_a_preset_with_pilots_is_timed(tmp_path: Path, command: Command) -> None:
    for number, image in enumerate(robust_film(40)[0]):
        write_image(tmp_path / "film" / f"{number:03d}.png", image)
    done = command(bench_cli.main, tmp_path / "film", "--threads", 1)
    assert "| film |" in done.stdout
    assert json.loads(done.stdout.splitlines()[-1])["frames"] == 40
