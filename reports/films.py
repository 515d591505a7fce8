"""Simulated films as a receiver sees them: windows whose bits are known, for suite and training."""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from data_gen.film.codec import through_codec
from data_gen.film.message import FilmSettings, Take, film_message
from data_gen.frame_pair import Cell
from data_gen.pictures.carriers import STILL, check_carriers
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from link.errors import InputError, ParameterError, choose
from link.layout import Layout
from link.observation import Observation
from link.presets import PRESETS
from models import FILM_GRAPH, shipped_graphs
from models.film.window import reads_films
from receiver.record import KnownWindow, record_windows
from reports.engine.predict import observe
from reports.engine.records import Truth

USUAL_FPS = 30.0
"""Number of frames a second of the camera where none is named."""
FILM_BYTES = 2000
"""Length of the filmed messages, bytes: their loops are longer than a film."""


def film_settings(name: str) -> FilmSettings:
    """Read what is shown and filmed: "PRESET", or "PRESET:FPS" for a camera of that rate.

    "PRESET:FPS:CARRIERS" says what carries the message, too, as `FilmSettings.carriers` does: a
    still picture where it is absent.

    Raises:
        InputError: there is no such preset, its films are not read as windows, the rate is no
            number, or there are no such carriers; the message names the presets or carriers.

    >>> film_settings("hidden:60").fps, film_settings("robust").state_hz
    (60.0, 15.0)
    """
    preset_name, _, rest = name.partition(":")
    rate, _, carriers = rest.partition(":")
    check_carriers(carriers := carriers or STILL)
    films = {key: preset for key, preset in PRESETS.items() if reads_films(preset.layout)}
    preset = choose(films, preset_name, "films")
    try:
        fps = float(rate or USUAL_FPS)
    except ValueError:
        raise ParameterError(
            "films", f"need PRESET, PRESET:FPS or PRESET:FPS:CARRIERS, got {name!r}"
        ) from None
    if not 1 <= fps <= 240:
        raise ParameterError("films", f"need 1 to 240 frames a second, got {fps:g}")
    return FilmSettings(
        kappa=preset.kappa,
        preset=preset_name,
        state_hz=preset.state_hz,
        fps=fps,
        n_bytes=FILM_BYTES,
        loops=20.0,
        carriers=carriers,
    )


@lru_cache(maxsize=4)
def _decoders(layout: Layout) -> tuple[Decoder, FilmGraph]:
    """Open the decoders that ship once in each process."""
    return Decoder(shipped_graphs()[layout], 1, OWN_TIME_LIMIT_S), FilmGraph(FILM_GRAPH, 1)


@dataclass(frozen=True)
class FilmOf:
    """One simulated film and the windows that are kept of it."""

    take: Take
    """What is filmed."""
    seconds: float
    """Length of the film, seconds."""
    most: int = 3
    """Largest number of windows that are kept."""

    def windows(self) -> list[KnownWindow]:
        """Film and receive: the kept windows, none where the display was not found."""
        settings = self.take.settings
        filmed = film_message(self.take)
        coded = through_codec(filmed.frames, settings.codec, settings.fps)
        frames = []
        for frame in coded:
            if frame.time_s > self.seconds:
                break
            frames.append((frame.rgb, frame.time_s))
        decoders = _decoders(settings.layout)
        return record_windows(frames, settings.fps, decoders, filmed.bits, self.most)


@dataclass(frozen=True)
class FilmSource:
    """Windows of simulated films, one of each film: `reports.engine.predict` decodes them."""

    settings: FilmSettings
    """What is shown, and how it is filmed."""
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
"""Number of films that are drawn for a window at most: a display may not be found in each."""


@observe.register
def _(source: FilmSource, cell: Cell, index: int, equalised: bool) -> tuple[Observation, Truth]:
    """Give the last window of a film in which the receiver has found the display.

    All methods get the same window, whatever pictures they would have the display show.
    """
    window, picture = _window_of(source, cell, index)
    bits = tuple(window.bits.reshape(-1).tolist())
    return window.observation, Truth(cell.pair, cell.view_deg, cell.kappa, picture, bits)


@lru_cache(maxsize=2)
def _window_of(source: FilmSource, cell: Cell, index: int) -> tuple[KnownWindow, str]:
    seconds = source.seconds * max(1.0, 60 / source.settings.fps)
    for number in range(index * TRIES, (index + 1) * TRIES):
        take = Take(source.settings, cell.pair, cell.view_deg, number, source.seed, source.split)
        if windows := FilmOf(take, seconds).windows():
            return windows[-1], film_message(take).picture
    raise InputError(f"the receiver found no display in {TRIES} films, number {index}")
