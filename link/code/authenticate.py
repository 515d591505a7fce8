"""Authentication says who sent a message: a stamp and a tag that only a holder of the key can make.

    signed message   message | stamp (4 bytes) | tag (8 bytes)
    tag              first 8 bytes of HMAC-SHA256(key, context | stamp | message)   (RFC 2104)

The stamp is a whole number that a receiver expects to rise: the seconds since 1970 at which the
message was made, or a counter. The seconds are the usual choice because then the sender need not
remember anything from one message to the next, and a receiver with a clock knows a message's age.
"""

import hashlib
import hmac
from dataclasses import dataclass
from pathlib import Path

from link.errors import InputError, ParameterError
from link.outside import read_bounded

MIN_KEY_BYTES, MAX_KEY_BYTES = 16, 4096
"""Smallest and largest number of bytes in a key."""
STAMP_BYTES, TAG_BYTES = 4, 8
"""Number of bytes that hold a message's stamp, and its tag."""
MAX_STAMP = 256**STAMP_BYTES - 1
"""Largest stamp; as seconds since 1970 it is reached in the year 2106."""
CONTEXT = b"oorc signed message 1\0"
"""Bytes that begin what a tag protects, so that a tag made for another purpose never fits."""
MAX_CLOCK_SKEW_S = 300
"""Time, in seconds, by which the sender's clock may be ahead of the receiver's where ages count."""


def read_key(file: Path) -> bytes:
    """Read a key: all bytes of a file, whatever they are.

    Raises:
        ParameterError: the file is missing or unreadable, or too short or too long for a key.
    """
    try:
        key = read_bounded(file, MAX_KEY_BYTES)
        check_key(key)
    except InputError as error:
        raise ParameterError("key", f"{file}: {str(error).removeprefix(f'{file}: ')}") from None
    return key


def check_key(key: bytes) -> None:
    """Raise an `InputError` where a key is too short or too long."""
    if not MIN_KEY_BYTES <= len(key) <= MAX_KEY_BYTES:
        raise InputError(
            f"need {MIN_KEY_BYTES} to {MAX_KEY_BYTES} random bytes, got {len(key)}; "
            "make a key with: head -c 32 /dev/urandom > FILE"
        )


def sign(message: bytes, key: bytes, stamp: int) -> bytes:
    """Append stamp and tag to a message.

    Args:
        message: at least 1 byte.
        key: 16 to 4096 bytes that sender and receiver share.
        stamp: seconds since 1970, or a counter, from 0 to 2**32 - 1.

    Returns:
        the signed message, 12 bytes longer.

    Raises:
        InputError: the message is empty, or the key or the stamp is out of bounds.

    >>> signed = sign(b"Hello", key=bytes(16), stamp=7)
    >>> (len(signed), verify(signed, key=bytes(16)))
    (17, SignedMessage(data=b'Hello', stamp=7))
    """
    check_key(key)
    if not message:
        raise ParameterError("message", "empty; give at least one byte")
    if not 0 <= stamp <= MAX_STAMP:
        raise ParameterError("stamp", f"need 0 to {MAX_STAMP}, got {stamp}")
    stamped = message + stamp.to_bytes(STAMP_BYTES, "big")
    return stamped + _tag(message, key, stamped[len(message) :])


def verify(signed: bytes, key: bytes) -> "SignedMessage | None":
    """Take a signed message apart where its tag fits; None where it does not.

    Tags are compared in a time that does not depend on where they differ.

    Args:
        signed: any bytes.
        key: 16 to 4096 bytes that sender and receiver share.

    Raises:
        InputError: the key is too short or too long.
    """
    check_key(key)
    message, end = unchecked(signed), signed[-STAMP_BYTES - TAG_BYTES :]
    stamp, tag = end[:STAMP_BYTES], end[STAMP_BYTES:]
    fits = hmac.compare_digest(_tag(message, key, stamp), tag)
    return SignedMessage(message, int.from_bytes(stamp, "big")) if fits and message else None


def unchecked(signed: bytes) -> bytes:
    """Take stamp and tag off a signed message, for one who has no key to check it with."""
    return signed[: -STAMP_BYTES - TAG_BYTES]


def _tag(message: bytes, key: bytes, stamp: bytes) -> bytes:
    """Stamp before message: the stamp has one length, so no two pairs of them read alike."""
    return hmac.digest(key, CONTEXT + stamp + message, hashlib.sha256)[:TAG_BYTES]


@dataclass(frozen=True)
class SignedMessage:
    """A message whose tag fits."""

    data: bytes
    """The bytes that were sent, without stamp and tag."""
    stamp: int
    """Seconds since 1970 at which the message was made, or the sender's counter."""


@dataclass(frozen=True)
class Judgement:
    """Judgement of a `Verifier` on a message."""

    signed: SignedMessage | None
    """The message, or None where its tag does not fit."""
    refused: str | None
    """Reason why it is not to be delivered, in words, or None where it is."""
    stale: bool = False
    """Whether the tag fits but the stamp is too old, as it is where a recording is shown again."""


class Verifier:
    """Judges messages one after another: delivered are those that verify and are not stale.

    Args:
        key: 16 to 4096 bytes that sender and receiver share.
        max_age_s: largest age of a message in seconds, where stamps are seconds since 1970; None
            for any age.

    Raises:
        InputError: the key is too short or too long, or the age is no positive number.

    >>> verifier = Verifier(key=bytes(16))
    >>> for signed in (sign(b"new", bytes(16), 8), sign(b"old", bytes(16), 7), b"from a stranger"):
    ...     print(verifier.judge(signed, now=0).refused)
    None
    stale: its stamp 7 is older than 8, which was delivered before
    the tag does not fit; made without the key, or with another one
    """

    def __init__(self, key: bytes, max_age_s: float | None = None) -> None:
        check_key(key)
        if max_age_s is not None and not 0 < max_age_s <= MAX_STAMP:
            raise ParameterError(
                "max_age", f"need more than 0 and at most {MAX_STAMP} seconds, got {max_age_s:g}"
            )
        self._key = key
        self._max_age_s = max_age_s
        self.newest: int | None = None
        """Largest stamp of a message that was to be delivered, or None before the first."""

    def judge(self, message: bytes, now: float) -> Judgement:
        """Judge the next message.

        Args:
            message: the bytes that were received, any.
            now: seconds since 1970; they count where there is a largest age.
        """
        signed = verify(message, self._key)
        if signed is None:
            reason = "the tag does not fit; made without the key, or with another one"
            return Judgement(None, reason)
        age = now - signed.stamp
        if self.newest is not None and signed.stamp < self.newest:
            reason = (
                f"its stamp {signed.stamp} is older than {self.newest}, which was delivered before"
            )
            return Judgement(signed, f"stale: {reason}", stale=True)
        if self._max_age_s is not None and age > self._max_age_s:
            reason = f"made {age:.0f} s ago, and --max-age is {self._max_age_s:g}"
            return Judgement(signed, f"stale: {reason}", stale=True)
        if self._max_age_s is not None and age < -MAX_CLOCK_SKEW_S:
            reason = f"made {-age:.0f} s ahead of this machine's clock; are both clocks right?"
            return Judgement(signed, reason)
        self.newest = signed.stamp
        return Judgement(signed, None)
