"""From camera frames to events: what `receiver` prints, and what the package returns."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from link.code.authenticate import Verifier
from link.presets import preset_name
from receiver.decoders import PairDecoder, WindowDecoder
from receiver.diagnosis import explain_silence
from receiver.events import ClockEvent, DisplayEvent, EndEvent, FilmEvent, PairEvent
from receiver.inbox import Inbox
from receiver.reading.reader import DecodedPair
from receiver.receiver import Receiver, ReceiverStep

MAX_PRINTED_BITS = 256
"""Largest number of bits of a frame pair that its event holds where no scores are asked for."""


class EventStream:
    """Reads a film, and says what each frame brought.

    Args:
        decoders: one for each layout that is looked for.
        fps: nominal number of frames of the camera in a second.
        verifier: decides which messages are delivered; None where all are.
        scores: whether frame pairs come with their scores, too.
        film: decodes windows of film; None where all is read by frame pairs.

    Raises:
        InputError: the decoders are no good; see `Receiver`.
    """

    def __init__(
        self,
        decoders: Sequence[PairDecoder],
        fps: float,
        verifier: Verifier | None = None,
        scores: bool = False,
        film: WindowDecoder | None = None,
    ) -> None:
        self.receiver = Receiver(decoders, fps, film)
        """Reads the frames."""
        self.inbox = Inbox(verifier)
        """Holds the message that was delivered last."""
        self.step = ReceiverStep(None, [], None)
        """Results of the last frame."""
        self._scores = scores
        self._in_view = self._clocked = False
        self._time = 0.0

    def push(self, image: NDArray[np.generic], time: float, name: str) -> list[FilmEvent]:
        """Take the next camera frame.

        Args:
            image: (H, W) or (H, W, 3) uint8 or uint16, encoded RGB.
            time: time of the frame, seconds; rising from frame to frame.
            name: name of the frame.

        Raises:
            InputError: not an image.
        """
        receiver = self.receiver
        self.step = receiver.push(image, time)
        self._time = time
        tracked = self.step.tracked
        events: list[FilmEvent] = []
        elsewhere = self._in_view and tracked is not None and tracked.anew
        if (tracked is not None) != self._in_view or elsewhere:
            self._in_view = tracked is not None
            seen = DisplayEvent(event="display", time=round(time, 4), frame=name, corners=None)
            if tracked is not None:
                seen["corners"] = tracked.corners.round(2).tolist()
                seen["preset"] = preset_name(receiver.layout)
            events.append(seen)
        if receiver.synchronised != self._clocked:
            self._clocked = receiver.synchronised
            rate = receiver.state_hz
            state_hz = None if rate is None else round(rate, 3)
            events.append(ClockEvent(event="clock", time=round(time, 4), state_hz=state_hz))
        return events + self._decoded()

    def finish(self) -> list[FilmEvent]:
        """Decode what is left when the frames have ended."""
        self.step = self.receiver.finish()
        return self._decoded()

    def _decoded(self) -> list[FilmEvent]:
        events: list[FilmEvent] = [pair_event(pair, self._scores) for pair in self.step.pairs]
        if self.step.message is not None:
            events.append(self.inbox.take(self.step.message))
        return events

    def end(self) -> EndEvent:
        """Sum up what was read."""
        timing, last = self.receiver.timing, self.inbox.last
        return EndEvent(
            event="end",
            frames=self.receiver.frames,
            frames_with_display=self.receiver.found,
            seconds=round(self._time, 3),
            message=last.text if last else None,
            milliseconds={
                stage: round(1e3 * seconds / timing.count[stage], 2)
                for stage, seconds in timing.spent.items()
            },
        )

    @property
    def explanation(self) -> str:
        """The message's length, or what was seen so far and why none came, in one line."""
        last = self.inbox.last
        if last is not None:
            times = f"{self.receiver.decoded} frame pairs of {self.receiver.frames} camera frames"
            return f"a message of {len(last.data)} bytes came, after {times}"
        return explain_silence(replace(self.receiver.observations, refused=self.inbox.refused))


def pair_event(pair: DecodedPair, scores: bool) -> PairEvent:
    """Say what a frame pair brought, with its scores where ``scores`` is true."""
    event = PairEvent(
        event="pair",
        pair=pair.number,
        time=round(pair.time, 4),
        erased=int((pair.soft.scores == 0).sum()),
        confidence=round(float(np.mean(1 / (1 + np.exp(-np.abs(pair.soft.scores))))), 4),
        frames=list(pair.shown.frames),
        progress=round(pair.progress, 4),
    )
    if scores or pair.soft.scores.size <= MAX_PRINTED_BITS:
        event["bits"] = "".join(map(str, pair.soft.bits))
    if scores:
        event["scores"] = [round(float(score), 3) for score in pair.soft.scores]
    return event
