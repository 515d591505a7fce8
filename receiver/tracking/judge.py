"""Say whether a display that is followed is one still: whether it toggles, and can be read."""

from collections.abc import Sequence

import cv2
import numpy as np

from link.images import as_gray
from link.layout import Layout
from link.pilots import pilot_values
from link.types import Real
from receiver.pilots.compensate import Compensator
from receiver.pilots.motion import map_size
from receiver.pilots.toggling import find_toggling
from receiver.pilots.waves import position
from receiver.seen import SeenFrame, SeenFrames

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

    def has_stopped(self, frame: SeenFrame, before: SeenFrames) -> bool:
        """Look at the pilots from time to time, and tell whether they toggle no more.

        Where a picture moves, they may be seen only in what is left of the frames once what has
        only moved is taken off.

        Args:
            frame: the next frame in which the display is followed.
            before: the frames before.
        """
        if not self._layout.pilots or frame.followed % CHECK_EVERY or frame.followed < WATCHED:
            return False
        toggles = [*list(before.toggles)[1 - WATCHED :], (frame.time, frame.toggles)]
        toggle = self._toggle(toggles) or self._toggle(self._left([*before.whole, frame]))
        self._missed = 0 if toggle else self._missed + 1
        return self._missed >= (PATIENCE if frame.followed > WATCHED else 1)

    def _toggle(self, toggles: Sequence[tuple[float, Real]]) -> bool:
        """Tell whether the values of pilots at some times, in seconds, toggle; not by a few."""
        if len(toggles) < CHECK_EVERY:
            return False
        at = [position(time - self._start, self._fps) for time, _ in toggles]
        evidence, _ = find_toggling([each for _, each in toggles], self._layout, at, self._fps)
        return evidence >= LEAST_EVIDENCE

    def _left(self, frames: Sequence[SeenFrame]) -> list[tuple[float, Real]]:
        """Measure the pilots in what is left of frames beyond motion, at the frames' times."""
        compensator, size = Compensator(self._fps), map_size(self._layout)
        left = []
        for frame in frames[-WATCHED:]:
            gray = cv2.resize(as_gray(frame.rectified), size, interpolation=cv2.INTER_AREA)
            changes = compensator.take(np.asarray(gray, np.uint8))
            left.append((frame.time, pilot_values(changes, self._layout)))
        return left[1:]  # nothing comes before the first one

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
