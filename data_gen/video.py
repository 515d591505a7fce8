"""A camera films a display that runs free.

python -m data_gen.video --pair canon-lg --view 45 --kappa 3 --message TEXT --out DIR (or FILE.mkv)

Between camera and display nothing is in step: each image row mixes the states that the display
shows while the row is open, as linear light. Left out: a video codec (each frame is stored as the
camera stores stills), motion within one frame, and a row's motion against the next.
"""

import json
import zlib
from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, fields, replace
from itertools import count
from pathlib import Path

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.channel.camera import collect
from data_gen.channel.display import Light
from data_gen.channel.optics import check_view
from data_gen.channel.timing import shares
from data_gen.channel.viewpoint import Viewpoint
from data_gen.effects import parse_settings
from data_gen.film.passer import Passer, draw_passer
from data_gen.film.scenes import Scene, SceneSettings, draw_scene
from data_gen.film.shake import Exposure, Hand
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.parameters import Pair
from link.code.framing import encode
from link.embed import check_kappa
from link.errors import InputError, at_least, run_cli
from link.geometry import frame_corners, transform
from link.images import make_folder, write_bytes, write_image
from link.layout import Layout, make_layout
from link.loop import Loop
from link.video import write_video

States = Sequence[NDArray[np.uint8]] | Callable[[int], NDArray[np.uint8]]
MAX_CLOCK_ERROR = 0.01
KEPT = 64
"""States whose light is kept at once."""
GRID_PX = 4
"""Shares are computed at points so far apart where the panel's rows are written one by one."""
PAN_S = 0.5
"""Time in which the camera turns away, and back."""
TRUTH = "truth.jsonl"


@dataclass(frozen=True)
class VideoSettings:
    """What may be chosen of a stream; None is drawn at random."""

    scene: SceneSettings = field(default_factory=lambda: SceneSettings(free=0.03))
    """Size of the frames, coverage, room, pictures in the room."""
    fps: float = 30.0
    """Camera frames a second, by the camera's clock."""
    state_hz: float = 15.0
    """States a second, by the display's clock: original, embedded, original, ..."""
    seconds: float | None = None
    """Length of the stream; None for an endless one."""
    clock_error: float | None = None
    """A second of the camera lasts 1 + clock_error seconds of the display; drawn within ±0.01."""
    start_s: float | None = None
    """Time of the loop at which the camera joins; drawn within the loop, or the first minute."""
    response_s: float = 0.004
    """Time constant of the panel's pixels (assumed: 9 ms from 10 to 90 per cent)."""
    scan_s: float = 1 / 60
    """Time in which the panel writes its rows, top to bottom (assumed: a refresh of 60 Hz)."""
    hand: float = 1.0
    """Motion of the hand relative to `shake.DRIFT`; 0 for a tripod."""
    exposure_drift: float | None = None
    """Standard deviation of the log exposure, within seconds; None for the pair's drift."""
    jumps_hz: float = 0.0
    """Automatic exposure makes for another level so many times a second."""
    drop: float = 0.0
    """Probability that a camera frame is lost: its number is left out."""
    duplicate: float = 0.0
    """Probability that a camera frame is the one before, again."""
    passer_s: tuple[float, float] | None = None
    """Someone crosses the image between these times of the stream."""
    away_s: tuple[float, float] | None = None
    """The camera looks elsewhere between these times of the stream."""

    def __post_init__(self) -> None:
        for flag, rate in (("fps", self.fps), ("state-hz", self.state_hz)):
            if not 0.1 <= rate <= 1000:
                raise InputError(f"--{flag}: need 0.1 to 1000 a second, got {rate:g}")
        if self.clock_error is not None and not abs(self.clock_error) <= 0.1:
            raise InputError(f"--clock-error: need a share within ±0.1, got {self.clock_error:g}")
        for flag, share in (("drop", self.drop), ("duplicate", self.duplicate)):
            if not 0 <= share < 1:
                raise InputError(f"--{flag}: need a probability in [0, 1), got {share:g}")
        for flag, span in (("passer-s", self.passer_s), ("away-s", self.away_s)):
            if span is not None and not span[0] < span[1]:
                raise InputError(f"--{flag}: the end must come after the start, got {span}")


@dataclass(frozen=True, eq=False)
class VideoFrame:
    """A camera frame and the truth about it."""

    rgb: NDArray[np.uint8]
    """(H, W, 3) encoded RGB."""
    number: int
    """Of the sensor's frame; lost frames are counted, too."""
    time_s: float
    """number / fps: the camera's own time."""
    display_s: float
    """Time of the loop, by the display's clock, at which the first row opens."""
    H_captured_from_display: NDArray[np.float64]
    """(3, 3)."""
    states: dict[int, float]
    """Share of each state in the light of the display's part of the image; they sum to 1. State k
    is number k modulo the loop's length; in a frame without display, what it would have shown."""
    visible: bool
    """Whether the whole picture lies within the image; someone may stand before it all the same."""
    duplicate: bool
    """Whether ``rgb`` is that of the frame before."""


def film(
    states: States,
    layout: Layout,
    pair: Pair,
    view_deg: float,
    settings: VideoSettings,
    rng: np.random.Generator,
) -> Iterator[VideoFrame]:
    """Film a display that shows states in a loop.

    Args:
        states: (height, width) or (height, width, 3) uint8 encoded frames, shown in turn and over
            again; or what gives state number k = 0, 1, 2, ...
        layout: of the picture.
        pair: camera and display.
        view_deg: nominal angle of observation, degrees.
        settings: what is not drawn.
        rng: every random draw comes from here.

    Raises:
        InputError: see `draw_scene`, or there is no state.
    """
    if not callable(states) and not len(states):
        raise InputError("a display needs at least one state to show")
    scene_rng, rng = rng.spawn(2)
    scene = draw_scene(layout, pair, view_deg, scene_rng, settings.scene)
    return _Filming(states, scene, settings, rng).frames()


class _Filming:
    """One stream: what stays the same, and the processes that go on from frame to frame."""

    def __init__(
        self, states: States, scene: Scene, settings: VideoSettings, rng: np.random.Generator
    ) -> None:
        self.states, self.scene, self.settings = states, scene, settings
        draws, view_rng, hand_rng, exposure_rng, loss_rng, noise_rng = rng.spawn(6)
        error = draws.uniform(-MAX_CLOCK_ERROR, MAX_CLOCK_ERROR)
        loop_s = 60.0 if callable(states) else len(states) / settings.state_hz
        start = draws.uniform(0, loop_s)
        self.clock = 1 + (error if settings.clock_error is None else settings.clock_error)
        self.start = start if settings.start_s is None else settings.start_s
        self.flicker = draws.random()
        self.view = Viewpoint.draw(scene, view_rng)
        self.hand = Hand(scene.size, settings.hand, hand_rng)
        drift = settings.exposure_drift
        drift = scene.pair.nuisance(scene.view_deg).drift if drift is None else drift
        self.exposure = Exposure(drift, settings.jumps_hz, 0.2, exposure_rng)
        self.loss_rng, self.noise_rng = loss_rng, noise_rng
        self.passer = self._draw_passer(draws) if settings.passer_s is not None else None
        self.backwards = draws.random() < 0.5
        self.away = np.array([np.cos(a := draws.uniform(0, 2 * np.pi)), np.sin(a)])
        self.lights: OrderedDict[int, Light] = OrderedDict()

    def frames(self) -> Iterator[VideoFrame]:
        """The stream."""
        settings, before = self.settings, None
        for number in count():
            time_s = number / settings.fps
            if settings.seconds is not None and time_s >= settings.seconds:
                return
            lost, again = self.loss_rng.random(2) < (settings.drop, settings.duplicate)
            motion = self._turned(time_s) @ self.hand.step(1 / settings.fps)
            gain = self.exposure.step(1 / settings.fps)
            if lost:
                continue
            if again and before is not None:
                before = replace(before, number=number, time_s=time_s, duplicate=True)
            else:
                before = self._frame(number, time_s, motion, gain)
            yield before

    def _frame(
        self, number: int, time_s: float, motion: NDArray[np.float64], gain: float
    ) -> VideoFrame:
        scene, display = self.scene, self.scene.pair.display
        H = motion @ scene.H_captured_from_display
        H = H / H[2, 2]
        opens = self.start + time_s * self.clock
        region = self.view.region(H)
        first, weights = self._shares(opens, H, region)
        lights = [self._light(first + k) for k in range(len(weights))]
        exposure = self.view.expose(
            lights,
            weights.astype(np.float32),
            H,
            gain,
            (self.flicker + display.pwm_hz * opens) % 1,
            motion,
            self._before(time_s),
        )
        mean = weights.reshape(len(weights), -1).mean(axis=1)
        points = transform(H, frame_corners(scene.layout.width, scene.layout.height))
        inside = (points >= -0.5).all() and (points <= np.array(scene.size) - 0.5).all()
        return VideoFrame(
            rgb=self.view.develop(exposure, self.noise_rng),
            number=number,
            time_s=time_s,
            display_s=opens,
            H_captured_from_display=H,
            states={first + k: float(share) for k, share in enumerate(mean) if share > 0},
            visible=bool(inside),
            duplicate=False,
        )

    def _shares(
        self, opens: float, H: NDArray[np.float64], region: tuple[int, int, int, int]
    ) -> tuple[int, NDArray[np.float64]]:
        """First state and (S, h, 1) or (S, h, w) shares in the region's pixels."""
        settings, camera = self.settings, self.scene.pair.camera
        height = self.scene.size[1]
        left, top, right, bottom = region
        if right <= left or bottom <= top:
            left, top, right, bottom = 0, 0, *self.scene.size
        rows = opens + camera.readout_s * np.arange(top, bottom)[:, None] / height

        def of(times: NDArray[np.float64]) -> tuple[int, NDArray[np.float64]]:
            return shares(times, camera.shutter_s, settings.state_hz, settings.response_s)

        if settings.scan_s <= 0:
            return of(rows)
        back = np.linalg.inv(H)
        x, y = np.meshgrid(_grid(left, right), _grid(top, bottom))
        row = (back[1, 0] * x + back[1, 1] * y + back[1, 2]) / (
            back[2, 0] * x + back[2, 1] * y + back[2, 2]
        )
        written = settings.scan_s * np.clip((row + 0.5) / self.scene.layout.height, 0, 1)
        first, coarse = of(opens + camera.readout_s * y / height - written)
        if len(coarse) == 1:
            return first, np.ones((1, bottom - top, 1))
        return first, _finer(coarse, bottom - top, right - left)

    def _light(self, state: int) -> Light:
        """Emitted light of a state, of the kept ones or anew."""
        state = max(0, state) if callable(self.states) else state % len(self.states)
        if state not in self.lights:
            frame = self.states(state) if callable(self.states) else self.states[state]
            self.lights[state] = self.view.emitted(frame)
        self.lights.move_to_end(state)
        if len(self.lights) > KEPT:
            self.lights.popitem(last=False)
        return self.lights[state]

    def _turned(self, time_s: float) -> NDArray[np.float64]:
        """(3, 3) motion of a camera that looks elsewhere for a while."""
        motion = np.eye(3)
        if self.settings.away_s is not None:
            start, end = self.settings.away_s
            share = np.clip(min(time_s - start, end - time_s) / PAN_S, 0, 1)
            smooth = share**2 * (3 - 2 * share)
            motion[:2, 2] = 1.2 * smooth * self.away * max(self.scene.size)
        return motion

    def _draw_passer(self, rng: np.random.Generator) -> Passer:
        """A figure about as tall as the image."""
        height = self.scene.size[1]
        tall = int(height * rng.uniform(0.7, 1.1))
        passer = draw_passer(int(tall * rng.uniform(0.35, 0.55)), tall, self.scene.level, rng)
        pair = self.scene.pair
        return replace(passer, light=collect(passer.light, pair.camera, pair.crosstalk))

    def _before(self, time_s: float) -> tuple[Passer, float, float] | None:
        """Who stands before the display, and where."""
        if self.passer is None or self.settings.passer_s is None:
            return None
        start, end = self.settings.passer_s
        share = (time_s - start) / (end - start)
        if not 0 <= share <= 1:
            return None
        width, height = self.scene.size
        tall, wide = self.passer.cover.shape[:2]
        share = 1 - share if self.backwards else share
        bob = 0.01 * height * np.sin(2 * np.pi * 1.8 * time_s)
        return self.passer, share * (width + wide) - wide, height - tall + 0.01 * height + bob


def _grid(low: int, high: int) -> NDArray[np.int_]:
    """Points GRID_PX apart, from the first pixel to the last or beyond."""
    return np.arange(low, high + GRID_PX, GRID_PX)


def _finer(coarse: NDArray[np.float64], height: int, width: int) -> NDArray[np.float64]:
    """Linear interpolation of (S, h, w) values of `_grid` to (S, height, width)."""
    scale = np.diag([GRID_PX, GRID_PX, 1.0])[:2]
    return np.array(
        [cv2.warpAffine(c.astype(np.float32), scale, (width, height), borderMode=1) for c in coarse]
    )


@dataclass(frozen=True)
class FilmConfig:
    """A simulated camera stream of a display that shows a message (see README)."""

    out: Path
    """Folder for PNGs named by frame number and truth.jsonl, or a lossless .mkv or .avi, beside
    which the truth lies as .jsonl; in a video file, a lost frame leaves no gap."""
    message: str
    pair: str = "canon-lg"
    """Camera and display: canon|nikon|sony - imac|lg|samsung."""
    view: float = 0.0
    """Angle of observation, degrees from the display's normal."""
    kappa: int = 3
    """Gray levels of [0, 255] added where a bit is 1."""
    fps: float = 30.0
    state_hz: float = 15.0
    """States a second: original, embedded, original, ..."""
    seconds: float = 10.0
    seed: int = 0
    split: str = "test"
    """Pictures and draws: "train" or "test"."""
    pictures: Path | None = None
    """Folder with your own pictures."""
    shown: int = 1
    """Pictures that the display shows in turn, a frame pair each; 1 for a static picture."""
    first: int = 0
    """Number of the first of them."""
    size: tuple[int, int] = (1280, 720)
    """Width and height of a camera frame, pixels."""
    coverage: float | None = None
    """Share of the image that the picture covers, 0.05 to 0.9; drawn where absent."""
    turn: float | None = None
    """Rotation of the camera about its axis, degrees; drawn where absent."""
    room: str | None = None
    """"dark", "office" or "bright"; drawn where absent."""
    second_display: bool | None = None
    """Whether another lit display stands beside; drawn where absent."""
    hand: float = 1.0
    """Motion of the hand relative to the usual; 0 for a tripod."""
    clock_error: float | None = None
    """Camera's clock against the display's; drawn within ±0.01 where absent."""
    start_s: float | None = None
    """Time of the loop at which the camera joins; drawn where absent."""
    jumps_hz: float = 0.0
    """Jumps of the exposure a second."""
    drop: float = 0.0
    """Probability that a camera frame is lost."""
    duplicate: float = 0.0
    """Probability that a camera frame repeats the one before."""
    passer_s: tuple[float, float] | None = None
    """Someone crosses the image between these times."""
    away_s: tuple[float, float] | None = None
    """The camera looks elsewhere between these times."""
    rows: int = 8
    cols: int = 8
    width: int = 512
    """Of the displayed picture, pixels."""
    height: int = 384
    ratex: int = 5
    """Ratex patches: 0, 1, 2, 3 or 5."""
    without: tuple[str, ...] = ()
    """Effects of the channel to switch off, such as drift or moire (data_gen/effects.py)."""
    set: tuple[str, ...] = ()
    """Parameters of the channel, such as metering=1 glare=0.1 (data_gen/parameters.py)."""


def settings_of(config: FilmConfig, source: Source) -> VideoSettings:
    """The stream that the command line asks for; the room holds pictures of the source's split."""
    scene = SceneSettings(
        size=config.size,
        coverage=config.coverage,
        turn_deg=config.turn,
        room=config.room,
        second_display=config.second_display,
        pictures=shuffled_pictures(source),
        free=0.03,
    )
    names = {entry.name for entry in fields(VideoSettings)} & {f.name for f in fields(config)}
    return VideoSettings(scene=scene, **{name: getattr(config, name) for name in names})


def line_of(frame: VideoFrame, file: str | None) -> str:
    """The truth about a frame, as a line of JSON."""
    line = {
        "file": file,
        "number": frame.number,
        "time_s": round(frame.time_s, 6),
        "display_s": round(frame.display_s, 6),
        "states": {str(k): round(share, 4) for k, share in frame.states.items()},
        "visible": frame.visible,
        "duplicate": frame.duplicate,
        "H_captured_from_display": frame.H_captured_from_display.tolist(),
    }
    return json.dumps(line, allow_nan=False)


def main() -> None:
    """Film, and write frames and truth."""
    config = tyro.cli(FilmConfig)
    check_view(config.view)
    kappa = check_kappa(config.kappa)
    at_least(0, seed=config.seed, first=config.first)
    at_least(1, shown=config.shown)
    if not 0 < config.seconds <= 3600:
        raise InputError(f"--seconds: need more than 0 and at most 3600, got {config.seconds:g}")
    if config.out.suffix not in ("", ".mkv", ".avi"):
        raise InputError(f"--out: need a folder, or a file .mkv or .avi, got {config.out}")
    layout = make_layout(config.rows, config.cols, config.width, config.height, config.ratex)
    source = Source(
        layout,
        config.split,
        config.seed,
        pictures=config.pictures,
        without=config.without,
        parameters=parse_settings(config.set),
    )
    pair, settings = source.pair(config.pair), settings_of(config, source)
    chosen = [
        settings.scene.pictures[(config.first + k) % len(settings.scene.pictures)].rgb
        for k in range(config.shown)
    ]
    bits = encode(config.message.encode(), layout.n_bits)
    loop = Loop(layout, kappa, bits, lambda: iter(chosen))
    states = list(loop.states())
    name = f"film/{config.split}/{config.pair}/{config.view:g}"
    rng = np.random.default_rng([config.seed, zlib.crc32(name.encode())])
    stream = film(states, layout, pair, config.view, settings, rng)
    folder = config.out if config.out.suffix == "" else config.out.parent
    make_folder(folder)
    truth = folder / TRUTH if config.out.suffix == "" else config.out.with_suffix(".jsonl")
    if truth.exists():
        raise InputError(f"--out: {truth} is there already; choose another name")
    lines: list[str] = []

    def frames() -> Iterator[NDArray[np.uint8]]:
        for frame in tqdm(stream, total=int(config.seconds * config.fps), unit="frame"):
            file = None if config.out.suffix else f"{frame.number:06d}.png"
            if file:
                write_image(config.out / file, frame.rgb)
            lines.append(line_of(frame, file))
            yield frame.rgb

    if config.out.suffix:
        write_video(config.out, frames(), config.fps)
    else:
        for _ in frames():
            pass
    write_bytes(truth, ("\n".join(lines) + "\n").encode())
    report = {
        "out": str(config.out),
        "truth": str(truth),
        "camera_frames": len(lines),
        "simulated": True,
        **loop.report(len(config.message.encode()), config.state_hz),
    }
    print(json.dumps(report))


if __name__ == "__main__":
    run_cli(main)
