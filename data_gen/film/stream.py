"""A hand-held camera films a display that runs free of it.

Between camera and display nothing is in step: each image row mixes the states that the display
shows while the row is open, as linear light (`data_gen.channel.panel`). What a phone's image
processor does to the frames is in `data_gen.film.phone`, and its video codec in
`data_gen.film.codec`. Left out: a row's motion against the next.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from itertools import count
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from data_gen.channel.composition import Shot
from data_gen.channel.display import Light, room_light
from data_gen.channel.panel import Panel
from data_gen.film.exposure import Exposure, ExposureProgram
from data_gen.film.frame import VideoFrame
from data_gen.film.phone import PhoneProcessor, PhoneSettings, blur_by_motion
from data_gen.film.scenes import Scene, SceneSettings, draw_scene
from data_gen.film.shake import ExposureDrift, Hand, Wander
from data_gen.parameters import Pair
from link.errors import ParameterError, in_range
from link.geometry import in_image, transform
from link.layout import Layout


class StateLoop(Protocol):
    """States of a loop by their number, such as a list of them."""

    def __len__(self) -> int:
        """Count the states."""

    def __getitem__(self, number: int, /) -> NDArray[np.uint8]:
        """Give a state, or make it."""


States = StateLoop | Callable[[int], NDArray[np.uint8]]
"""The states that a display shows: those of a loop, or a function of the state's number."""
MAX_CLOCK_ERROR = 0.01
"""Largest share by which the drawn clocks of camera and display differ."""
UNENDING_LOOP_S = 60.0
"""Time, in seconds, within which a camera joins a display that shows no loop."""
LAMP_SHARE = 0.6
"""Share of the camera's way by which a mirrored lamp moves over the display: that of a lamp which
is 1.5 times as far from the display as the camera (assumed)."""
SETTLING_FRAMES, SETTLED_S = 4, 10.0
"""Number of frames, and of seconds after each, in which automatic exposure finds the light before a
film begins."""
MAX_JITTER = 0.45
"""Largest share of the time from frame to frame by which the sensor takes a frame early or late."""


@dataclass(frozen=True)
class VideoSettings:
    """What may be chosen about a stream; None is drawn at random."""

    scene: SceneSettings = field(default_factory=lambda: SceneSettings(free=0.03))
    """Size of the frames, coverage, room, and pictures in the room."""
    fps: float = 30.0
    """Number of camera frames a second, by the camera's clock. Of more than 64 the cameras expose
    each for a shorter time, with more noise (`data_gen.parameters.Camera.filming`)."""
    state_hz: float = 15.0
    """Number of states a second, by the display's clock: original, embedded, original, ..."""
    seconds: float | None = None
    """Length of the stream in seconds; None for an endless one."""
    clock_error: float | None = None
    """Share by which a second of the camera is longer than one of the display; within ±0.01 where
    drawn."""
    start_s: float | None = None
    """Time of the loop, in seconds, at which the camera joins; within the loop where drawn."""
    shutter: float | None = None
    """Exposure time of each frame, seconds; None for the camera's own, which an automatic exposure
    chooses by the light."""
    hand: float = 1.0
    """Motion of the hand, and of the camera with it, relative to the usual; 0 for a tripod."""
    jumps_hz: float = 0.0
    """Number of times a second that automatic exposure makes for another level."""
    drop: float = 0.0
    """Probability that a camera frame is lost: its number is left out."""
    duplicate: float = 0.0
    """Probability that a camera frame is the one before, again."""
    jitter_s: float = 0.0
    """Standard deviation, in seconds, of how early or late the sensor takes a frame; the frame's
    time says so. It is cut off at 0.45 of the time from frame to frame."""
    phone: PhoneSettings = field(default_factory=PhoneSettings)
    """What a phone does to the frames after the camera's own processing; by default nothing."""

    def check(self) -> None:
        """Raise a `ParameterError` that names the first setting that is out of its range."""
        in_range(
            self,
            fps=(0.1, 1000, " a second"),
            state_hz=(0.1, 1000, " a second"),
            jumps_hz=(0, 1000, " a second"),
            clock_error=(-0.1, 0.1, ""),
            start_s=(-1e6, 1e6, " seconds"),
            shutter=(1e-5, 1, " seconds"),
            hand=(0, 100, ""),
            jitter_s=(0, 1, " seconds"),
        )
        for name, share in (("drop", self.drop), ("duplicate", self.duplicate)):
            if not 0 <= share < 1:
                raise ParameterError(name, f"need a probability in [0, 1), got {share:g}")
        self.phone.check()


def film(
    states: States,
    layout: Layout,
    pair: Pair,
    view_deg: float,
    settings: VideoSettings,
    rng: np.random.Generator,
) -> Iterator[VideoFrame]:
    """Film a display that shows states in a loop.

    >>> from data_gen.pairs import get_pair
    >>> from link.layout import make_layout
    >>> states = [np.full((96, 128, 3), level, np.uint8) for level in (200, 205)]
    >>> settings = VideoSettings(SceneSettings(size=(160, 96)), seconds=0.1)
    >>> layout, rng = make_layout(4, 4, 128, 96, 2), np.random.default_rng(0)
    >>> frames = list(film(states, layout, get_pair("canon-lg"), 20.0, settings, rng))
    >>> len(frames), frames[0].rgb.shape
    (3, (96, 160, 3))

    Args:
        states: (height, width) or (height, width, 3) uint8 encoded frames, shown in turn and over
            again, which may be made when they are asked for; or a function that gives state number
            k = 0, 1, 2, ...
        layout: layout of the picture.
        pair: camera and display.
        view_deg: nominal angle of observation, degrees.
        settings: what is chosen and not drawn.
        rng: source of every random draw.

    Raises:
        InputError: there is no state, ``view_deg`` or a setting is out of range, or the pair is
            without perspective.
    """
    settings.check()
    if not callable(states) and not len(states):
        raise ParameterError("states", "a display needs at least one state to show")
    pair = replace(pair, camera=pair.camera.filming(settings.fps, settings.shutter))
    scene_rng, rng = rng.spawn(2)
    scene = draw_scene(layout, pair, view_deg, scene_rng, settings.scene)
    frames = _Stream(states, scene, settings, rng).frames()
    phone = settings.phone
    phone = replace(phone, distortion=phone.distortion or pair.camera.distortion)
    processor = PhoneProcessor(phone, (layout.width, layout.height), rng.spawn(1)[0])
    return map(processor.process, frames)


class _Stream:
    """One stream: what stays the same, and the processes that go on from frame to frame."""

    def __init__(
        self, states: States, scene: Scene, settings: VideoSettings, rng: np.random.Generator
    ) -> None:
        self.states, self.scene, self.settings = states, scene, settings
        draws, viewpoint_rng, hand_rng, exposure_rng, loss_rng, noise_rng, jitter_rng = rng.spawn(7)
        error = draws.uniform(-MAX_CLOCK_ERROR, MAX_CLOCK_ERROR)
        loop_s = UNENDING_LOOP_S if callable(states) else len(states) / settings.state_hz
        start = draws.uniform(0, loop_s)
        self.clock = 1 + (error if settings.clock_error is None else settings.clock_error)
        self.start = start if settings.start_s is None else settings.start_s
        layout, display, camera = scene.layout, scene.pair.display, scene.pair.camera
        self.viewpoint = scene.viewpoint(viewpoint_rng)
        size, light_of = (layout.width, layout.height), self.viewpoint.own_light
        self.panel = Panel(display, size, self._state, light_of, settings.state_hz, draws.random())
        self.hand = Hand(scene.size, settings.hand, hand_rng)
        self.sway = Wander(3, hand_rng.spawn(1)[0])
        self.program = (
            ExposureProgram(camera, display.white_cd, settings.fps, settings.shutter)
            if camera.auto_exposure
            else None
        )
        drift = scene.pair.nuisance(scene.view_deg).drift
        self.exposure = ExposureDrift(drift, settings.jumps_hz, exposure_rng)
        self.loss_rng, self.noise_rng, self.jitter_rng = loss_rng, noise_rng, jitter_rng

    def frames(self) -> Iterator[VideoFrame]:
        """Yield the frames that are not lost, in order."""
        settings, scene, previous = self.settings, self.scene, None
        late_before, motion_before = 0.0, None
        for number in count():
            if settings.seconds is not None and number / settings.fps >= settings.seconds:
                return
            late = self._jitter() if number else 0.0
            time_s, step_s = number / settings.fps + late, 1 / settings.fps + (late - late_before)
            lost, again = self.loss_rng.random(2) < (settings.drop, settings.duplicate)
            motion = self.hand.step(step_s)
            way = settings.hand * scene.pair.setup.sway * self.sway.step(step_s)
            gain = self.exposure.step(step_s)
            shutter_shift = self._shutter_shift(motion_before, motion, step_s)
            late_before, motion_before = late, motion
            if lost:
                continue
            if again and previous is not None:
                previous = replace(previous, number=number, time_s=time_s, duplicate=True)
            else:
                if self.program is not None:
                    if previous is None:
                        self._settle(time_s, motion, way)
                    self.program.step(step_s)
                previous = self._film_frame(number, time_s, motion, way, gain, shutter_shift)
            yield previous

    def _jitter(self) -> float:
        """Draw by how many seconds the sensor takes a frame after its time."""
        limit, jitter_s = MAX_JITTER / self.settings.fps, self.settings.jitter_s
        return float(np.clip(jitter_s * self.jitter_rng.standard_normal(), -limit, limit))

    def _shutter_shift(
        self, before: NDArray[np.float64] | None, motion: NDArray[np.float64], step_s: float
    ) -> NDArray[np.float64] | None:
        """Return the shift (2,), in pixels, of the image's centre while the shutter is open."""
        if before is None or not self.settings.phone.motion_blur:
            return None
        middle = [(np.array(self.scene.size) - 1) / 2]
        velocity = (transform(motion, middle) - transform(before, middle))[0] / step_s
        return np.asarray(self._exposure().shutter_s * velocity)

    def _settle(self, time_s: float, motion: NDArray[np.float64], way: NDArray[np.float64]) -> None:
        """Let automatic exposure find the light that is there before the film begins."""
        assert self.program is not None
        for _ in range(SETTLING_FRAMES):
            now = self.program.exposure()
            shot = self._shot(motion, way, now, now.gain)
            light, _ = self._light(shot, self.start + time_s * self.clock, way, now.shutter_s)
            self.program.meter(shot.expose_light(light), now.gain)
            self.program.step(SETTLED_S)

    def _film_frame(
        self,
        number: int,
        time_s: float,
        motion: NDArray[np.float64],
        way: NDArray[np.float64],
        gain: float,
        shutter_shift: NDArray[np.float64] | None,
    ) -> VideoFrame:
        """Expose and develop one frame of a camera that has moved."""
        scene, now = self.scene, self._exposure()
        shot = self._shot(motion, way, now, now.gain * gain)
        opens = self.start + time_s * self.clock
        light, shares = self._light(shot, opens, way, now.shutter_s)
        exposure = shot.expose_light(light)
        if self.program is not None:
            self.program.meter(exposure, now.gain * gain)
        if shutter_shift is not None:
            exposure = blur_by_motion(exposure, shutter_shift)
        H = shot.H_captured_from_display
        inside = in_image(transform(H, scene.layout.corners), exposure.shape)
        return VideoFrame(
            rgb=shot.develop(exposure, self.noise_rng),
            number=number,
            time_s=time_s,
            display_s=opens,
            H_captured_from_display=H,
            states=shares,
            visible=bool(inside.all()),
            duplicate=False,
        )

    def _exposure(self) -> Exposure:
        """Return the exposure that the program has chosen, or the one that the camera keeps."""
        if self.program is not None:
            return self.program.exposure()
        return Exposure(1.0, self.scene.pair.camera.shutter_s, self.viewpoint.iso)

    def _shot(
        self,
        motion: NDArray[np.float64],
        way: NDArray[np.float64],
        now: Exposure,
        gain: float,
    ) -> Shot:
        """Return the exposure of a camera that its hand has turned and carried along."""
        motions: tuple[NDArray[np.float64], ...] = (motion,)
        if way.any():
            motions = tuple(motion @ moved for moved in self.scene.parallax(way))
        H = motions[-1] @ self.scene.H_captured_from_display
        return Shot(self.viewpoint, H / H[2, 2], gain, None, motions, now.iso)

    def _light(
        self, shot: Shot, opens: float, way: NDArray[np.float64], shutter_s: float
    ) -> tuple[Light, dict[int, float]]:
        """Return the mean light of the display while a camera's rows are open, and its states.

        Args:
            shot: the exposure.
            opens: time of the loop, in seconds, at which the first row opens.
            way: (3,) the camera's way, as `Scene.parallax` takes it.
            shutter_s: time for which each row is open, seconds.
        """
        scene, points = self.scene, self.panel.points
        # (h, w, 2) -> (h w, 2) -> (h, w)
        rows = transform(shot.H_captured_from_display, points.reshape(-1, 2))[:, 1]
        rows = np.clip(rows.reshape(points.shape[:2]) / scene.size[1], -1, 2)
        light, shares = self.panel.exposed(opens + scene.pair.camera.readout_s * rows, shutter_s)
        light += self._room(way)
        return light, shares

    def _room(self, way: NDArray[np.float64]) -> Light:
        """Return the room light of the display, as `Viewpoint.room`, from where the camera is."""
        if not way.any():
            return self.viewpoint.room
        size = self.scene.layout.width, self.scene.layout.height
        lamp = self.viewpoint.lamp + LAMP_SHARE * way[:2] * max(size) / size
        return room_light(self.scene.pair.display, size[1], size[0], lamp)[:, :, None]

    def _state(self, number: int) -> NDArray[np.uint8]:
        """Return the picture of a state by its number."""
        if callable(self.states):
            return self.states(max(0, number))
        return self.states[number % len(self.states)]
