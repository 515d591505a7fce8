"""Films of messages: all that is drawn for one, such as a picture, a room, a pose, and the hand.

`film_message` draws it by the seed, the camera-display pair and the angle of a `Take`.
"""

import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from data_gen.film.codec import CodecSettings
from data_gen.film.frame import VideoFrame
from data_gen.film.phone import PhoneSettings
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import States, VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.pictures.carriers import open_carrier
from link.code.framing import encode
from link.errors import choose
from link.layout import Layout
from link.loop import Loop, LoopStates, MovingStates, PictureAt, loop_of_picture
from link.presets import PRESETS

IN_STEP = 0.5
"""Share of films with a moving carrier of which both states of a frame pair show one picture, as
where a program makes them. Of the others each state shows the picture of its own time, as where a
browser's video element changes the picture when it likes."""


@dataclass(frozen=True)
class FilmSettings:
    """A message in a hand-held video (simulated): what the display shows, and how it is filmed."""

    kappa: int = 3
    """Gray levels added to a block that carries a 1."""
    preset: str = "paper"
    """Preset whose grid, modulation and pilots or patches the display shows; kappa and rates are
    those of the other flags."""
    state_hz: float = 15.0
    """Number of states that the display shows a second; two of them are a frame pair."""
    fps: float = 30.0
    """Number of frames that the camera takes a second."""
    n_bytes: int = 100
    """Length of the message, bytes."""
    carriers: str = "still"
    """What carries the message: "still" for a picture that stands still, "moving" for a film of a
    scene that is drawn for each film anew, or the name of a scene (data_gen/pictures/moving.py) or
    of a video file."""
    shows_message: bool = True
    """Whether the display shows the message; else it shows what would carry it, and toggles
    nothing."""
    loops: float = 3.0
    """Number of loops of the message after which a run is given up."""
    coverage: tuple[float, float] = (0.15, 0.6)
    """Least and largest share of the image that the display covers; drawn between them."""
    size: tuple[int, int] = SceneSettings.size
    """Width and height of a camera frame, pixels."""
    shutter: float | None = VideoSettings.shutter
    """Exposure time of each frame, seconds; None for the camera's own."""
    phone: PhoneSettings = field(default_factory=PhoneSettings)
    """What a phone does to the frames before they are compressed."""
    codec: CodecSettings = field(default_factory=CodecSettings)
    """Codec through which the frames pass."""

    @classmethod
    def of_preset(cls, name: str, **changed: Any) -> "FilmSettings":
        """Show a preset at its own kappa and rate, with other settings changed by name.

        Raises:
            InputError: there is no such preset; the message lists the names.

        >>> FilmSettings.of_preset("hidden", fps=120).kappa
        1
        """
        preset = choose(PRESETS, name, "preset")
        return cls(kappa=preset.kappa, preset=name, state_hz=preset.state_hz, **changed)

    @property
    def layout(self) -> Layout:
        """Layout that the display shows."""
        return choose(PRESETS, self.preset, "preset").layout


@dataclass(frozen=True)
class Take:
    """One film of a message that is to be received."""

    settings: FilmSettings
    """What is shown, and how it is filmed."""
    pair: str
    """Camera-display pair."""
    view: float
    """Angle between the camera and the normal of the display, degrees."""
    run: int
    """Number of the run among those of the pair and view."""
    seed: int
    """Seed of all draws."""
    split: str = "test"
    """Split of the pictures from which the message's picture is drawn."""

    @property
    def name(self) -> str:
        """Name of the film among those of one setting."""
        return f"{self.pair} {self.view:g} {self.run}"


@dataclass(frozen=True, eq=False)
class MessageFilm:
    """A film of a message, drawn and ready to be taken."""

    take: Take
    """Setting, pair, view and number of the film."""
    picture: str
    """Name of the picture or of the film that carries the message."""
    message: bytes
    """Message that the display sends."""
    bits: NDArray[np.integer]
    """Bits of the loop's frame pairs, (loop frames, n_bits) of 0 or 1."""
    frames: Iterator[VideoFrame]
    """Frames of at most as many loops as the setting allows; they can be taken once."""


def film_message(take: Take) -> MessageFilm:
    """Draw a message, what carries it, and how it is filmed; no frame is filmed yet."""
    config = take.settings
    layout = config.layout
    grid = layout.rows if config.preset == "paper" else config.preset
    setting = f"{config.kappa} {grid} {config.state_hz} {config.fps}"
    key = f"{take.pair} {take.view} {take.run} {setting}"
    rng = np.random.default_rng([take.seed, zlib.crc32(key.encode())])
    source = Source(layout, take.split, take.seed)
    pictures = shuffled_pictures(source)
    picture = pictures[int(rng.integers(len(pictures)))]
    message = rng.bytes(config.n_bytes)
    bits = encode(message, layout.n_bits)
    even = PRESETS[config.preset].even
    loop = loop_of_picture(layout, config.kappa, bits, picture.rgb, even)
    coverage = float(rng.uniform(*config.coverage))
    settings = VideoSettings(
        SceneSettings(config.size, coverage, pictures=pictures, free=0.03),
        config.fps,
        config.state_hz,
        seconds=config.loops * 2 * len(bits) / config.state_hz,
        shutter=config.shutter,
        phone=config.phone,
    )
    states: States = LoopStates(loop)
    name, carrier = picture.name, None
    if config.carriers != "still":
        carrier_rng = np.random.default_rng([take.seed, zlib.crc32(f"carrier {key}".encode())])
        carrier = open_carrier(config.carriers, pictures, carrier_rng)
        name = carrier.name
        in_step = bool(carrier_rng.random() < IN_STEP)
        states = MovingStates(loop, carrier, config.state_hz, in_step)
    if not config.shows_message:
        states = plain_states(loop, carrier or (lambda _: picture.rgb), config.state_hz)
    frames = film(states, layout, source.pair(take.pair), take.view, settings, rng)
    return MessageFilm(take, name, message, bits, frames)


def plain_states(loop: Loop, picture_at: PictureAt, state_hz: float) -> States:
    """Make the states of a display that shows a loop's pictures as they are.

    Args:
        loop: how pictures lie on the display.
        picture_at: the film, or a picture that stands still.
        state_hz: number of states a second.
    """

    def state(number: int) -> NDArray[np.uint8]:
        laid = loop.placement.grid_frame(picture_at(number / state_hz), loop.layout)
        return loop.placement.display_frame(laid, loop.layout)

    return state
