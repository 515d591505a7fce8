"""Say whether a display that is followed is one still: whether it toggles, and can be read."""

from collections.abc import Iterable

from link.layout import Layout
from link.types import Real
from receiver.pilots.toggling import find_toggling
from receiver.pilots.waves import position
from receiver.seen import SeenFrame

WATCHED = 48
"""Number of frames over which the pilots of a followed display are watched."""
CHECK_EVERY = 24
"""Number of frames from one look at the pilots to the next."""
LEAST_EVIDENCE = 4.0
"""Smallest evidence (`receiver.pilots.toggling.find_toggling`) at which the pilots are still
seen."""
PATIENCE = 3
"""Number of looks in a row without evidence after which the display counts as lost. One is enough
at the first look: pilots that were beyond doubt a moment ago are gone."""
STILL_S, STILL_FRAMES = 1.25, 36
"""Time, in seconds, and number of frames for which a display with patches is followed without
anything to read before others are looked for, too: a picture that shows patches may stand still."""
AMISS_PAIRS = 64
"""Number of frame pairs that are read in vain before a display with pilots is looked for anew: some
of its corners may lie elsewhere."""


class Judge:
    """Judges one display from when it was found.

    Pilots are watched themselves. Patches are seen in each frame, whether they toggle or not: they
    are judged by what is read, and so are pilots whose corners may lie amiss. The display's clock
    is no judge: it says when states change, and runs on where nothing toggles for a while.

    Args:
        layout: layout of the display.
        fps: nominal number of frames of the camera in a second.
        time: time of the frame in which the display was found, seconds.
        frames: number of frames taken by then.
        decoded: number of frame pairs decoded by then.
    """

    def __init__(self, layout: Layout, fps: float, time: float, frames: int, decoded: int) -> None:
        self._layout, self._fps, self._start = layout, fps, time
        self._read = time, frames, decoded
        self._missed = 0

    def has_stopped(self, frame: SeenFrame, toggles: Iterable[tuple[float, Real]]) -> bool:
        """Look at the pilots from time to time, and tell whether they toggle no more.

        Args:
            frame: the next frame in which the display is followed.
            toggles: `receiver.seen.SeenFrames.toggles` of the frames before.
        """
        if not self._layout.pilots or frame.followed % CHECK_EVERY or frame.followed < WATCHED:
            return False
        watched = [*list(toggles)[1 - WATCHED :], (frame.time, frame.toggles)]
        at = [position(time - self._start, self._fps) for time, _ in watched]
        evidence, _ = find_toggling([each for _, each in watched], self._layout, at, self._fps)
        self._missed = 0 if evidence >= LEAST_EVIDENCE else self._missed + 1
        return self._missed >= (PATIENCE if frame.followed > WATCHED else 1)

    def is_read_in_vain(self, time: float, frames: int, decoded: int, *, reads: bool) -> bool:
        """Tell whether the display has been followed for long without anything to read.

        What toggles around a picture with patches may give it a clock, but no bit of a message.

        Args:
            time: time of the frame that comes now, seconds.
            frames: number of frames taken.
            decoded: number of frame pairs decoded.
            reads: whether the clock is known and a part of the message.
        """
        if reads:
            self._read = time, frames, decoded
        since, frames_before, decoded_before = self._read
        in_vain = time - since > STILL_S and frames - frames_before > STILL_FRAMES
        return decoded - decoded_before > AMISS_PAIRS if self._layout.pilots else in_vain
