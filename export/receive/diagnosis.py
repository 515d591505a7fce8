"""Say why no message came: what was seen, and what to try, in one line."""

from dataclasses import dataclass

from export.receive.timing.synchronise import MIN_FRAMES, MIN_TOGGLE, Toggling

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
CUT = 0.97
"""Share of the display within the image below which it counts as partly in view."""
OFTEN = 0.2
"""Share of the frames with the display from which a fault counts as that of the film."""


@dataclass(frozen=True)
class Observations:
    """What a receiver has seen of a film from which no message came."""

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
    decoded: int = 0
    """Number of frame pairs decoded."""
    mixed: float = 0.0
    """Share in [0, 1] of the blocks' scores that exposures over two states have cost."""
    progress: float = 0.0
    """Information received for the message, as a share of what is needed."""
    refused: int = 0
    """Number of messages that were refused."""


def explain_silence(seen: Observations) -> str:
    """Say in one line what was seen, why there is no message, and what to try.

    >>> explain_silence(Observations(fps=30, frames=90, level=9.0))
    'no display that is looked for in any of 90 frames, which are dark (mean level 9 \
of 255): more light or a longer exposure'
    """
    if seen.refused > 0:
        return (
            f"every message was refused ({seen.refused}); the lines above say why; is it the "
            "sender's key?"
        )
    if seen.found == 0:
        return _explain_nothing_found(seen)
    view = f"the display is in view in {seen.found} of {seen.frames} frames"
    return f"{view}{_light_and_cut(seen)}, {_explain_signal(seen)}"


def _explain_nothing_found(seen: Observations) -> str:
    nothing = f"no display that is looked for in any of {seen.frames} frames"
    if seen.level is not None and seen.level < DARK:
        dark = f"which are dark (mean level {seen.level:.0f} of 255)"
        return f"{nothing}, {dark}: more light or a longer exposure"
    if seen.clipped > BRIGHT:
        bright = f"{seen.clipped:.0%} of whose pixels are at the camera's limit"
        return f"{nothing}, {bright}: a shorter exposure"
    return (
        f"{nothing}; check preset or --model, focus, exposure, that most of the display is "
        "in view, and that the film is not mirrored"
    )


def _light_and_cut(seen: Observations) -> str:
    """Say what is wrong with the view of the display; empty where nothing is."""
    faults = []
    if seen.level is not None and seen.level < DARK:
        faults.append(f"dark there (mean level {seen.level:.0f} of 255; more light)")
    if seen.clipped > BRIGHT:
        faults.append(f"{seen.clipped:.0%} of it at the camera's limit (a shorter exposure)")
    if seen.cut > OFTEN * seen.found:
        faults.append(f"only in part in {seen.cut} of them (move back or turn the camera)")
    return "".join(f", {fault}" for fault in faults)


def _explain_signal(seen: Observations) -> str:
    """Say what became of the toggling of the display's patches."""
    toggling = seen.toggling
    if seen.decoded > 0:
        return _explain_pairs(seen)
    if seen.state_hz is not None:
        return (
            f"and its clock was found ({seen.state_hz:.1f} states a second), but the film ended "
            "before a frame pair was whole; film longer"
        )
    if toggling is None:
        return (
            f"for {seen.seconds:.1f} s; to find the display's clock takes {MIN_FRAMES} frames or "
            "more; film longer"
        )
    if toggling.deviation < MIN_TOGGLE:
        return (
            f"but its patches or pilots do not change (by less than {MIN_TOGGLE:g} gray levels); "
            "is the sender playing, and are its states shown for a camera frame or longer?"
        )
    if toggling.strength < NOISE_STRENGTH:
        return (
            "but its patches or pilots change no more regularly than noise "
            f"({toggling.strength:.0%} of the evidence that a clock needs); is the sender playing, "
            f"is --fps right ({seen.fps:g}), and does each of its states last a camera frame or "
            "longer? Film closer or steadier, or send with a larger --kappa"
        )
    return (
        f"and its patches or pilots toggle weakly (by {toggling.amplitude:.1f} gray levels at "
        f"{toggling.state_hz:.1f} states a second, {toggling.strength:.0%} of the evidence that a "
        "clock needs); film longer, closer or steadier, or send with a larger --kappa"
    )


def _explain_pairs(seen: Observations) -> str:
    """Say why the frame pairs that were decoded gave no message."""
    pairs = f"and {seen.decoded} frame pairs gave {seen.progress:.0%} of the information needed"
    rate = seen.state_hz
    if rate is not None and rate > TOO_FAST * seen.fps and seen.mixed > MIXED:
        return (
            f"{pairs}: the display shows {rate:.1f} states a second and the camera takes "
            f"{seen.fps:g} frames, so most exposures mix two states; send at {seen.fps / 2:g} "
            "states a second or film at a higher rate"
        )
    return f"{pairs}; film longer or closer, or send with a larger --kappa"
