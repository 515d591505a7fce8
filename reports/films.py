"""Simulated films as a receiver sees them: windows whose bits are known, for suite and training."""

from dataclasses import dataclass
from functools import lru_cache

from data_gen.film.codec import through_codec
from data_gen.film.message import FilmSettings, Take, film_message
from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from link.errors import ParameterError, choose
from link.layout import Layout
from link.presets import PRESETS
from models import FILM_GRAPH, shipped_graphs
from models.film.window import reads_films
from receiver.record import KnownWindow, record_windows

USUAL_FPS = 30.0
"""Number of frames a second of the camera where none is named."""
FILM_BYTES = 2000
"""Length of the filmed messages, bytes: their loops are longer than a film."""


def film_settings(name: str) -> FilmSettings:
    """Read what is shown and filmed: "PRESET", or "PRESET:FPS" for a camera of that rate.

    Raises:
        InputError: there is no such preset, its films are not read as windows, or the rate is no
            number; the message names the presets.

    >>> film_settings("hidden:60").fps, film_settings("robust").state_hz
    (60.0, 15.0)
    """
    preset_name, _, rate = name.partition(":")
    films = {key: preset for key, preset in PRESETS.items() if reads_films(preset.layout)}
    preset = choose(films, preset_name, "films")
    try:
        fps = float(rate or USUAL_FPS)
    except ValueError:
        raise ParameterError("films", f"need PRESET or PRESET:FPS, got {name!r}") from None
    if not 1 <= fps <= 240:
        raise ParameterError("films", f"need 1 to 240 frames a second, got {fps:g}")
    return FilmSettings(
        kappa=preset.kappa,
        preset=preset_name,
        state_hz=preset.state_hz,
        fps=fps,
        n_bytes=FILM_BYTES,
        loops=20.0,
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
