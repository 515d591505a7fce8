"""Simulated films as a receiver sees them, cut as own films are (`reports.captured.receive`).

The comparison decodes what was cut, and the film decoder is trained on it.
"""

from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import takewhile
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

USUAL_FPS = 30.0
"""Number of frames a second of the camera where none is named."""
SECONDS = 1.4
"""Length of the films that are compared, as `film_cuts` takes it, seconds."""
WINDOWS_A_FILM = 3
"""Largest number of windows that are kept of a film."""
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


def film_cuts(take: Take, seconds: float) -> list[KnownWindow | Captured]:
    """Film and receive: `WINDOWS_A_FILM` windows, or all frame pairs where these are read.

    What cannot be matched with the loop is left out; there is nothing where the display was not
    found.

    Args:
        take: setting of the film: preset, rate and kind of picture.
        seconds: length of the film for a camera of 60 frames a second; slower ones film longer.
    """
    settings = take.settings
    filmed = film_message(take)
    coded = through_codec(filmed.frames, settings.codec, settings.fps)
    last = seconds * max(1.0, 60 / settings.fps)
    seen = takewhile(lambda frame: frame.time_s <= last, coded)
    frames = ((frame.rgb, frame.time_s) for frame in seen)
    cuts = receive_film(frames, settings.fps, settings.layout, apart=False).cuts
    if cuts and cuts[0].window is not None:
        kept = np.linspace(0, len(cuts) - 1, WINDOWS_A_FILM).round().astype(int)
        cuts = [cuts[at] for at in np.unique(kept)]
    found: list[KnownWindow | Captured] = []
    for cut in cuts:
        match = match_loop(cut.scores, filmed.bits)
        found += cut.known(match.bits, ends=True) if match.kind == "fits" else []
    return [replace(each, meta={"picture": filmed.picture}) for each in found]


@dataclass(frozen=True)
class FilmSource:
    """Cuts of simulated films of test pictures, which `reports.engine.predict` decodes."""

    settings: FilmSettings
    """Setting of the film: what is shown, and how it is filmed."""
    seed: int = 0
    """Seed of every random draw."""
    pictures: Path | None = None
    """None: films show the built-in pictures."""

    @property
    def layout(self) -> Layout:
        """Layout that the display shows."""
        return self.settings.layout

    def observe(self, cell: Cell, index: int, equalised: bool) -> KnownWindow | Captured:
        """Give the last window, or one of the last frame pairs, of a film with a found display.

        All methods get the same one, whatever pictures they would have the display show.
        """
        each = 1 if reads_films(self.layout) else PAIRS_A_FILM
        found = _film(self, cell, index // each, each)
        return replace(found[index % each], kappa=self.settings.kappa)


TRIES = 5
"""Number of films that are drawn for an observation at most: a display may not be found in each."""
PAIRS_A_FILM = 8
"""Number of observations of each film of a layout that is read by frame pairs; of others, a film
has one window."""


@lru_cache(maxsize=2)
def _film(source: FilmSource, cell: Cell, index: int, least: int) -> list[KnownWindow | Captured]:
    for number in range(index * TRIES, (index + 1) * TRIES):
        take = Take(source.settings, cell.pair, cell.view_deg, number, source.seed, "test")
        if len(found := film_cuts(take, SECONDS)) >= least:
            return found[-least:]
    raise InputError(f"the receiver found no display in {TRIES} films, number {index}")
