"""The inbox delivers a message that arrived whole, or refuses it and says why."""

import time
from dataclasses import replace

from link.code.authenticate import Verifier, unchecked
from link.code.collect import Message
from receiver.events import MessageEvent, RefusedEvent


class Inbox:
    """Delivers messages that a verifier accepts, and refuses all others.

    Args:
        verifier: decides which messages are delivered; None where all are.
    """

    def __init__(self, verifier: Verifier | None) -> None:
        self._verifier = verifier
        self.last: Message | None = None
        """The message that was delivered last, or None."""
        self.refused = 0
        """Number of messages that were refused."""

    def take(self, message: Message) -> MessageEvent | RefusedEvent:
        """Deliver a message, or refuse it and say why."""
        judged = self._verifier and self._verifier.judge(message.data, time.time())
        signed = judged.signed if judged else None
        if signed is not None:
            changed = self.last is not None and self.last.data != signed.data
            message = replace(message, data=signed.data, changed=changed)
        if judged and judged.refused is not None:
            self.refused += 1
            refused = RefusedEvent(
                event="refused",
                reason=judged.refused,
                stale=judged.stale,
                bytes=len(message.data),
                loop_frames=message.frames,
            )
            if signed is not None:
                refused["text"], refused["hex"] = message.text, message.data.hex()
                refused["stamp"] = signed.stamp
            return refused
        if not judged and message.signed:
            message = replace(message, data=unchecked(message.data))
        self.last = message
        event = MessageEvent(
            event="message",
            text=message.text,
            hex=message.data.hex(),
            loop_frames=message.frames,
            pairs_used=message.seen,
            confidence=round(message.agreement, 4),
        )
        if message.changed:
            event["changed"] = True
        if signed is not None:
            event["stamp"] = signed.stamp
        elif message.signed and not judged:
            event["signed"] = "not checked"
        return event
