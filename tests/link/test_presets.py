"""Presets: a name means the same to the sender and to simulated films, and flags change it."""

import json
from pathlib import Path

import pytest
from conftest import Command, Refuses

import data_gen.video as film_cli
from link.layout import make_layout
from link.presets import PRESETS

FILM = ("--message", "hi", "--seconds", 0.01, "--size", 160, 120)


@pytest.mark.parametrize("name", PRESETS)
def test_a_preset_is_one_whole(name: str) -> None:
    preset = PRESETS[name]
    assert preset.changed() == preset.layout
    assert preset.purpose.endswith(".")


def test_flags_change_what_a_film_takes_from_a_preset(tmp_path: Path, command: Command) -> None:
    small = ("--rows", 8, "--cols", 16, "--width", 128, "--height", 64, "--kappa", 2)
    done = command(film_cli.main, *FILM, "--preset", "hidden", *small, "--out", tmp_path / "a")
    said = json.loads(done.stdout)
    code = PRESETS["hidden"].layout.code
    layout = make_layout(8, 16, 128, 64, modulation="antipodal", pilots="auto", code=code)
    assert said["layout"] == layout.to_dict()
    assert (said["preset"], said["kappa"], said["state_hz"]) == ("hidden", 2, 60)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*PRESETS, None])
def test_a_film_shows_the_preset(name: str | None, tmp_path: Path, command: Command) -> None:
    flags = ("--preset", name) if name else ()
    done = command(film_cli.main, *FILM, *flags, "--out", tmp_path / "a")
    said = json.loads(done.stdout)
    preset = PRESETS[name or film_cli.FILMED_PRESET]
    assert said["preset"] == (name or film_cli.FILMED_PRESET)
    assert said["layout"] == preset.layout.to_dict()
    assert (said["kappa"], said["state_hz"]) == (preset.kappa, preset.state_hz)


def test_a_wrong_preset_gives_one_line(refuses: Refuses) -> None:
    says = "error: unknown preset 'loud'; choose one of: paper"
    refuses("data_gen.video", [*FILM, "--out", "a", "--preset", "loud"], says)
