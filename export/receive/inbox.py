"""What becomes of a message that arrived whole: it is printed, or refused and said so."""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from link.code.authenticate import Verifier, unchecked
from link.code.collect import Message
from link.errors import ParameterError
from link.images import write_bytes
from link.outside import is_no_file


def say(event: str, **what: Any) -> None:
    """Print one JSON line: what happened, and values of JSON's types."""
    print(json.dumps({"event": event, **what}), flush=True)


class Inbox:
    """Delivers messages: prints each, and writes the last one to a file.

    Args:
        out: file for the message's bytes; None for no file.
        verifier: decides which messages are delivered; None where all are.

    Raises:
        ParameterError: ``out`` cannot be a file.
    """

    def __init__(self, out: Path | None, verifier: Verifier | None) -> None:
        if out is not None and (not out.name or is_no_file(out)):
            raise ParameterError("out", f"{out} is a folder or a device; name a file")
        self._out = out
        self._verifier = verifier
        self.last: Message | None = None
        """The message that was delivered last, or None."""
        self.refused = 0
        """Number of messages that were refused."""

    def take(self, message: Message) -> bool:
        """Deliver a message, or say in one line why not; true where it was delivered.

        Raises:
            InputError: the file cannot be written.
        """
        more: dict[str, Any] = {}
        if self._verifier is not None:
            judged = self._verifier.judge(message.data, time.time())
            if judged.signed is not None:
                changed = self.last is not None and self.last.data != judged.signed.data
                message = replace(message, data=judged.signed.data, changed=changed)
                more["stamp"] = judged.signed.stamp
            if judged.refused is not None:
                self.refused += 1
                if judged.signed is not None:
                    more = {"text": message.text, "hex": message.data.hex(), **more}
                more |= {"bytes": len(message.data), "loop_frames": message.frames}
                say("refused", reason=judged.refused, stale=judged.stale, **more)
                return False
        elif message.signed:
            message = replace(message, data=unchecked(message.data))
            more["signed"] = "not checked"
        if message.changed:
            more["changed"] = True
        say(
            "message",
            text=message.text,
            hex=message.data.hex(),
            loop_frames=message.frames,
            pairs_used=message.seen,
            confidence=round(message.agreement, 4),
            **more,
        )
        self.last = message
        if self._out is not None:
            write_bytes(self._out, message.data)
        return True
