"""A message as a collector returns it."""

from dataclasses import dataclass
from typing import NamedTuple

MAX_SCORE = 8.0
"""Largest magnitude of a score, in log-likelihood units; larger ones are cut, because what covers a
block can look certain, and no single block should decide."""


class Content(NamedTuple):
    """Content of a loop, as `encode` takes it."""

    data: bytes
    """The bytes that were sent."""
    signed: bool = False
    """Whether they end with a stamp and a tag (`link.code.authenticate`), as the framing says."""


@dataclass(frozen=True)
class Message:
    """A message that arrived whole."""

    data: bytes
    """The bytes that were sent."""
    frames: int
    """Number of frames in the loop that carries the message."""
    seen: int
    """Number of received frames whose scores were used."""
    agreement: float
    """Share of the scores' weight that agrees with the message, in [0, 1]."""
    changed: bool = False
    """Whether the display showed another message before, which was delivered."""
    signed: bool = False
    """Whether the framing says that stamp and tag end the bytes (`link.code.authenticate`)."""

    @property
    def text(self) -> str:
        """The message read as UTF-8, with bytes that are no UTF-8 escaped."""
        return self.data.decode("utf-8", "backslashreplace")
