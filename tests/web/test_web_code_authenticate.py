"""The page delivers and refuses signed messages as Python's receiver does."""

import numpy as np
import pytest
from port import Port, PortError

from link.code.authenticate import MAX_CLOCK_SKEW_S, MAX_STAMP, Verifier, sign
from link.code.collect import Message
from receiver.inbox import Inbox

KEY = bytes(range(32))
NOW = 1_800_000_000
AHEAD = NOW + MAX_CLOCK_SKEW_S
FIRST, SECOND = sign(b"door open", KEY, NOW), sign(b"door shut", KEY, NOW + 60)
LONG = sign(np.random.default_rng(0).bytes(20_000), KEY, MAX_STAMP)
CHANGED = [FIRST[:at] + bytes([FIRST[at] ^ 1]) + FIRST[at + 1 :] for at in range(0, len(FIRST), 3)]
STRANGE = [b"", b"x", bytes(11), bytes(12), bytes(13), FIRST[:-1], FIRST + b"\0", *CHANGED]
AGED = {"old": NOW - 101, "from tomorrow": AHEAD + 1, "new": NOW - 100, "newer": AHEAD}
VERIFIERS = {
    "in order": (KEY, None, [(FIRST, NOW), (FIRST, NOW), (SECOND, NOW), (FIRST, NOW), (SECOND, 0)]),
    "strange": (KEY, None, [(data, NOW) for data in (*STRANGE, FIRST, LONG, SECOND)]),
    "another key": (bytes(16), None, [(FIRST, NOW), (sign(b"obey", bytes(16), 7), NOW)]),
    "long key": (bytes(4096), None, [(sign(b"long key", bytes(4096), 7), NOW)]),
    "ages": (KEY, 100.0, [(sign(text.encode(), KEY, at), NOW) for text, at in AGED.items()]),
}
"""A key, the largest age, and messages with the times at which they are judged."""
REASONS = {
    "in order": {None, "stale"},
    "strange": {None, "stale", "the t"},
    "another key": {None, "the t"},
    "long key": {None},
    "ages": {None, "stale", "made "},
}
"""How the reasons begin for which a verifier refuses some of its messages."""


@pytest.mark.parametrize("name", VERIFIERS)
def test_messages_are_judged_alike(port: Port, name: str) -> None:
    key, max_age_s, messages = VERIFIERS[name]
    verifier = Verifier(key, max_age_s)
    ported = port("link/code/authenticate.js").Verifier(key, max_age_s)
    reasons = set()
    for message, now in messages:
        known, found = verifier.judge(message, now), ported.judge(message, now)
        signed = found.signed and (bytes(found.signed.data), found.signed.stamp)
        assert signed == (known.signed and (known.signed.data, known.signed.stamp))
        said = known.refused and known.refused.replace(
            "--max-age is 100", "the largest age is 100 s"
        )
        assert (found.refused, found.stale) == (said, known.stale)
        assert ported.newest == verifier.newest
        reasons.add(known.refused and known.refused[:5])
    assert reasons == REASONS[name]


def test_messages_are_signed_alike(port: Port) -> None:
    for key, stamp in ((KEY, 0), (bytes(4096), MAX_STAMP)):
        signed = port("link/code/authenticate.js").sign(b"door open", key, stamp)
        assert bytes(signed) == sign(b"door open", key, stamp)


def test_keys_and_ages_have_bounds(port: Port) -> None:
    verifier = port("link/code/authenticate.js").Verifier
    for size in (0, 15, 4097):
        with pytest.raises(PortError, match="need 16 to 4096 random bytes"):
            verifier(bytes(size))
    for age in (0, -1, np.nan, np.inf, 1e300):
        with pytest.raises(PortError, match="maxAgeS: need more than 0"):
            verifier(bytes(16), age)


@pytest.mark.parametrize("key", [None, KEY], ids=["without a key", "with a key"])
def test_messages_are_delivered_alike(
    port: Port, monkeypatch: pytest.MonkeyPatch, key: bytes | None
) -> None:
    monkeypatch.setattr("time.time", lambda: float(NOW))
    texts = [(b"door open", 5), (b"door shut", 6), (b"door open", 5), (b"door shut", 7), (b"x", 8)]
    inbox = Inbox(None if key is None else Verifier(key))
    verifier = key and port("link/code/authenticate.js").Verifier(key)
    ported, message = (
        port("receiver/inbox.js").Inbox(verifier),
        port("link/code/message.js").Message,
    )
    for text, stamp in texts:
        data = sign(text, bytes(16) if text == b"x" else KEY, stamp)
        flagged = stamp % 2 == 1
        event = inbox.take(Message(data, 4, 3, 0.9, stamp > 5, flagged))
        delivered = event["event"] == "message"
        delivery = ported.take(message(data, 4, 3, 0.9, stamp > 5, flagged), NOW)
        assert (delivery.refused is None) == delivered
        assert vars(port("../package/events.js").messageEvent(delivery)) == event
        assert bytes(ported.last.data) == inbox.last.data
        assert ported.last.changed == inbox.last.changed
        assert ported.last.signed == inbox.last.signed
        assert ported.refused == inbox.refused
        assert not delivered or delivery.message == ported.last
    assert inbox.refused == (0 if key is None else 2)
