"""Say why no message came: what was seen, and what to try, in one line."""

from collections.abc import Sequence
from dataclasses import dataclass

from link.presets import PRESETS, least_camera_fps, needed_camera_fps
from receiver.timing.fit import MAX_STATES
from receiver.timing.synchronise import MIN_FRAMES, MIN_TOGGLE, Toggling

DARK, BRIGHT = 25.0, 0.3
"""Mean gray level of the display below which there is too little light, and share of its pixels at
the camera's limit above which there is too much."""
CLIPPED = 250
"""Gray level from which a pixel counts as at the camera's limit."""
NOISE_STRENGTH = 0.75
"""Share of the needed evidence that noise alone reaches now and then."""
TOO_FAST = 0.8
"""States a camera frame from which most exposures mix two states."""
MIXED = 0.5
"""Share of the blocks' scores that mixing must have cost to be named as the cause."""
ENOUGH = 1.3
"""Share of the needed information from which bits must be wrong where no message came."""
LONG = 1.4
"""Length of an exposure, in states, from which a shorter one is advised."""
CUT = 0.97
"""Share of the display within the image below which it counts as partly in view."""
DIMMED = ("still", "noise", "weak", "too little")
"""Reasons, keys of `WORDS`, of which too little light may be the cause."""
OFTEN = 0.2
"""Share of the frames with the display from which a fault counts as that of the film."""
PRESET_HZ = {name: preset.state_hz for name, preset in PRESETS.items()}
"""Number of states a second of each preset."""
LEAST_FPS = {
    name: least_camera_fps(preset.layout, preset.state_hz) for name, preset in PRESETS.items()
}
"""Smallest number of frames a second, of any camera, by which each preset is read."""
PRESET_FPS = {
    name: (preset.needs_camera_fps, needed_camera_fps(2 * preset.state_hz))
    for name, preset in PRESETS.items()
}
"""Smallest usual number of frames a second of a camera that reads each preset, and a better one."""

WORDS = {
    "refused": "every message was refused ({refused}); is it the sender's key?",
    "nothing": "no display that is looked for in any of {frames} frames",
    "nothing, dark": ", which are dark (mean level {level:.0f} of 255): come closer, or turn the "
    "display brighter",
    "nothing, bright": ", {clipped:.0%} of whose pixels are at the camera's limit: a shorter "
    "exposure",
    "nothing, else": "; check the preset, focus, exposure, that most of the display is in "
    "view, and that the film is not mirrored; flip it if it is",
    "slow": "; this camera takes {fps:.0f} frames a second, and a display with preset {fast} "
    "({fast_hz:g} states a second) needs at least {needed_fps:g}, better {better_fps:g}: film "
    "at a higher rate, which many cameras have at a smaller size, or show fewer states a second",
    "view": "the display is in view in {found} of {frames} frames",
    "dark": ", dark there (mean level {level:.0f} of 255; a longer exposure, a brighter picture or "
    "display)",
    "bright": ", {clipped:.0%} of it at the camera's limit (a shorter exposure)",
    "cut": ", only in part in {cut} of them (move back or turn the camera)",
    "no pair": ", and its clock was found ({state_hz:.1f} states a second), but the film ended "
    "before a frame pair was whole; film longer",
    "short": ", for {seconds:.1f} s; to find the display's clock takes {least_frames} frames or "
    "more; film longer",
    "still": ", but its patches or pilots do not change (by less than {least_toggle:g} gray "
    "levels); is the sender playing, and are its states shown for a camera frame or longer?",
    "noise": ", but its patches or pilots change no more regularly than noise ({strength:.0%} of "
    "the evidence that a clock needs); is the sender playing, does the camera take {fps:g} frames "
    "a second, and does each state last a camera frame or longer? Film closer or steadier, or send "
    "with a larger kappa",
    "weak": ", and its patches or pilots toggle weakly (by {amplitude:.1f} gray levels at "
    "{toggle_hz:.1f} states a second, {strength:.0%} of the evidence that a clock needs); film "
    "longer, closer or steadier, or send with a larger kappa",
    "pairs": ", and {decoded} frame pairs gave {progress:.0%} of the information needed",
    "too fast": ": the display shows {state_hz:.1f} states a second and the camera takes {fps:g} "
    "frames, so most exposures mix two states; send at {half_fps:g} states a second or film at a "
    "higher rate",
    "many states": "; the display shows {state_hz:.1f} states a second, and the camera takes "
    "{fps:g} frames: film closer or at a higher rate, or send at {half_fps:g} states a second",
    "long": "; each exposure lasts for {exposed:.1f} of the display's states, which blurs them: "
    "one of 1/{state_hz:.0f} s or less reads faster",
    "too little": "; film longer or closer, or send with a larger kappa",
    "wrong": ", so some of it is wrong: parts of the display may be too bright, or covered; film "
    "with a shorter exposure, or from another place",
}
"""Parts of the line by what was seen, with places for numbers as `str.format` takes them. The page
fills them in, too."""


@dataclass(frozen=True)
class Observations:
    """Counts of what a receiver saw in a film without a message; the advice follows from them."""

    fps: float
    """Nominal number of frames of the camera in a second."""
    frames: int = 0
    """Number of frames taken."""
    found: int = 0
    """Number of frames in which the display was found."""
    seconds: float = 0.0
    """Time from the first to the last frame in which the display was found, seconds."""
    level: float | None = None
    """Mean gray level in [0, 255] of the display, or of all frames where it was never found; None
    before the first frame."""
    clipped: float = 0.0
    """Share in [0, 1] of the pixels measured for ``level`` that are at the camera's limit."""
    cut: int = 0
    """Number of frames in which a part of the display lay outside the image."""
    toggling: Toggling | None = None
    """The strongest toggling that was found, or None where no clock was looked for."""
    state_hz: float | None = None
    """Number of states a second by the clock that was found last, or None where none was."""
    exposed: float = 0.0
    """Length of an exposure by that clock, in states of the display."""
    decoded: int = 0
    """Number of frame pairs decoded."""
    mixed: float = 0.0
    """Share in [0, 1] of the blocks' scores that exposures over two states have cost."""
    progress: float = 0.0
    """Information received for the message, as a share of what is needed."""
    refused: int = 0
    """Number of messages that were refused."""
    presets: Sequence[str] = ()
    """Names of the presets that are looked for, or of the one alone that was found last."""


def explain_silence(seen: Observations) -> str:
    """Say in one line what was seen, why there is no message, and what to try.

    >>> explain_silence(Observations(fps=30, frames=90, level=9.0))
    'no display that is looked for in any of 90 frames, which are dark (mean level 9 \
of 255): come closer, or turn the display brighter'
    """
    toggling = seen.toggling or Toggling(0.0, 0.0, 0.0, 0.0)
    fast = too_fast(seen) or ""
    needed_fps, better_fps = PRESET_FPS.get(fast, (0.0, 0.0))
    values = {
        **vars(seen),
        "half_fps": seen.fps / 2,
        "fast": fast,
        "fast_hz": PRESET_HZ.get(fast),
        "needed_fps": needed_fps,
        "better_fps": better_fps,
        "least_frames": MIN_FRAMES,
        "least_toggle": MIN_TOGGLE,
        "strength": toggling.strength,
        "amplitude": toggling.amplitude,
        "toggle_hz": toggling.state_hz,
    }
    return "".join(WORDS[part].format(**values) for part in reasons(seen))


def too_fast(seen: Observations) -> str | None:
    """Name the preset that needs the quickest camera, where this one is too slow for it."""
    rates = {LEAST_FPS[name]: name for name in seen.presets}
    return rates[max(rates)] if rates and max(rates) > MAX_STATES * seen.fps else None


def reasons(seen: Observations) -> list[str]:
    """Find what explains that no message came: keys of `WORDS`, in the order of the line."""
    dark = seen.level is not None and seen.level < DARK
    bright = seen.clipped > BRIGHT
    if seen.refused:
        return ["refused"]
    slow = ["slow"] if too_fast(seen) else []
    if seen.found == 0:
        cause = "nothing, dark" if dark else "nothing, bright" if bright else "nothing, else"
        return ["nothing", cause, *slow]
    causes = _causes(seen, slow)
    faults = ["dark"] * (dark and causes[-1] in DIMMED) + ["bright"] * bright
    return ["view", *faults, *["cut"] * (seen.cut > OFTEN * seen.found), *causes]


def _causes(seen: Observations, slow: list[str]) -> list[str]:
    """Find why a display that was found brought no message; ``slow`` as in `reasons`."""
    coded = any(LEAST_FPS[name] < PRESET_HZ[name] for name in seen.presets)
    if seen.decoded > 0:
        if seen.exposed > LONG:
            return ["pairs", "long"]
        if slow or coded or seen.state_hz is None or seen.state_hz <= TOO_FAST * seen.fps:
            return ["pairs", *(slow or ["wrong" if seen.progress > ENOUGH else "too little"])]
        return ["pairs", "too fast" if seen.mixed > MIXED else "many states"]
    if slow:
        return slow
    if seen.state_hz is not None:
        return ["no pair"]
    if seen.toggling is None:
        return ["short"]
    if seen.toggling.deviation < MIN_TOGGLE:
        return ["still"]
    return ["noise" if seen.toggling.strength < NOISE_STRENGTH else "weak"]
