"""Simulated films as a receiver sees them, cut as own films are (`reports.captured.receive`).

The comparison decodes what was cut, and the film decoder is trained on it.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from data_gen.film.codec import through_codec
from data_gen.film.message import FilmSettings, Take, film_message
from data_gen.frame_pair import Cell
from data_gen.pictures.carriers import STILL, check_carriers
from link.captures import KnownWindow
from link.errors import InputError, ParameterError, choose
from link.frames import Captured
from link.layout import Layout
from link.presets import PRESETS
from models.film.window import reads_films
from reports.captured.receive import receive_film
from reports.captured.truth import match_loop
from reports.engine.predict import observe

USUAL_FPS = 30.0
"""Number of frames a second of the camera where none is named."""
FILM_BYTES = 2000
"""Length of the filmed messages, bytes: their loops are longer than a film."""


def film_settings(name: str) -> FilmSettings:
    """Read what is shown and filmed: "PRESET", or "PRESET:FPS" for a camera of that rate.

    "PRESET:FPS:CARRIERS" says what carries the message, too, as `FilmSettings.carriers` does: a
    still picture where it is absent.

    Raises:
        InputError: there is no such preset, the rate is no number, or there are no such carriers;
            the message names the presets or carriers.

    >>> film_settings("hidden:60").fps, film_settings("robust").state_hz
    (60.0, 15.0)
    """
    preset_name, _, rest = name.partition(":")
    rate, _, carriers = rest.partition(":")
    check_carriers(carriers := carriers or STILL)
    choose(PRESETS, preset_name, "films")
    try:
        fps = float(rate or USUAL_FPS)
    except ValueError:
        raise ParameterError(
            "films", f"need PRESET, PRESET:FPS or PRESET:FPS:CARRIERS, got {name!r}"
        ) from None
    if not 1 <= fps <= 240:
        raise ParameterError("films", f"need 1 to 240 frames a second, got {fps:g}")
    return FilmSettings.of_preset(
        preset_name, fps=fps, n_bytes=FILM_BYTES, loops=20.0, carriers=carriers
    )


@dataclass(frozen=True)
class FilmOf:
    """One simulated film and the windows that are kept of it."""

    take: Take
    """Setting of the film: preset, rate and kind of picture."""
    seconds: float
    """Length of the film, seconds."""
    most: int = 3
    """Largest number of windows that are kept."""

    def cuts(self) -> list[KnownWindow | Captured]:
        """Film and receive: the kept windows, or all frame pairs where the layout is read by them.

        What cannot be matched with the loop is left out; there is nothing where the display was
        not found.
        """
        settings = self.take.settings
        filmed = film_message(self.take)
        coded = through_codec(filmed.frames, settings.codec, settings.fps)
        frames = []
        for frame in coded:
            if frame.time_s > self.seconds:
                break
            frames.append((frame.rgb, frame.time_s))
        cuts = receive_film(frames, settings.fps, settings.layout, apart=False).cuts
        if cuts and cuts[0].window is not None:
            kept = np.unique(np.linspace(0, len(cuts) - 1, self.most).round().astype(int))
            cuts = [cuts[at] for at in kept]
        found: list[KnownWindow | Captured] = []
        for cut in cuts:
            match = match_loop(cut.scores, filmed.bits)
            found += cut.known(match.bits, ends=True) if match.kind == "fits" else []
        return found


@dataclass(frozen=True)
class FilmSource:
    """Cuts of simulated films, which `reports.engine.predict` decodes."""

    settings: FilmSettings
    """Setting of the film: what is shown, and how it is filmed."""
    seed: int = 0
    """Seed of every random draw."""
    split: str = "test"
    """Split whose pictures and channel draws are used."""
    seconds: float = 1.4
    """Length of each film, seconds of a camera of 60 frames a second; slower ones film longer."""
    pictures: Path | None = None
    """None: films show the built-in pictures."""

    @property
    def layout(self) -> Layout:
        """Layout that the display shows."""
        return self.settings.layout


TRIES = 5
"""Number of films that are drawn for an observation at most: a display may not be found in each."""
PAIRS_A_FILM = 8
"""Number of observations of each film of a layout that is read by frame pairs; of others, a film
has one window."""


@observe.register
def _(source: FilmSource, cell: Cell, index: int, equalised: bool) -> KnownWindow | Captured:
    """Give the last window, or one of the last frame pairs, of a film whose display was found.

    All methods get the same one, whatever pictures they would have the display show.
    """
    each = 1 if reads_films(source.layout) else PAIRS_A_FILM
    found, picture = _film(source, cell, index // each, each)
    return replace(found[index % each], meta={"picture": picture})


@lru_cache(maxsize=2)
def _film(
    source: FilmSource, cell: Cell, index: int, least: int
) -> tuple[list[KnownWindow | Captured], str]:
    seconds = source.seconds * max(1.0, 60 / source.settings.fps)
    for number in range(index * TRIES, (index + 1) * TRIES):
        take = Take(source.settings, cell.pair, cell.view_deg, number, source.seed, source.split)
        if len(found := FilmOf(take, seconds).cuts()) >= least:
            return found[-least:], film_message(take).picture
    raise InputError(f"the receiver found no display in {TRIES} films, number {index}")
