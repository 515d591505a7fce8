"""The page delivers and refuses signed messages as Python's receiver does."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from web_fixtures import run_node_tests, write_fixture

from export.receive.inbox import Inbox
from link.code.authenticate import MAX_CLOCK_SKEW_S, MAX_STAMP, Verifier, sign
from link.code.collect import Message

KEY = bytes(range(32))
NOW = 1_800_000_000


def as_array(data: bytes) -> NDArray[np.uint8]:
    return np.frombuffer(data, np.uint8)


def judged(key: bytes, max_age_s: float | None, messages: list[tuple[bytes, float]]) -> Any:
    """What a verifier, and an inbox that has one, make of messages one after another."""
    verifier = Verifier(key, max_age_s)
    said = []
    for message, now in messages:
        judgement = verifier.judge(message, now)
        said.append(
            {
                "message": as_array(message),
                "now": now,
                "data": judgement.signed and as_array(judgement.signed.data),
                "stamp": judgement.signed and judgement.signed.stamp,
                "refused": judgement.refused,
                "stale": judgement.stale,
                "newest": verifier.newest,
            }
        )
    return {"key": as_array(key), "max_age_s": max_age_s, "said": said}


def test_messages_are_judged_alike(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    first, second = sign(b"door open", KEY, NOW), sign(b"door shut", KEY, NOW + 60)
    long = sign(rng.bytes(20_000), KEY, MAX_STAMP)
    changed = [
        first[:at] + bytes([first[at] ^ 1]) + first[at + 1 :] for at in range(0, len(first), 3)
    ]
    strange = [b"", b"x", bytes(11), bytes(12), bytes(13), first[:-1], first + b"\0", *changed]
    ahead = NOW + MAX_CLOCK_SKEW_S
    verifiers = [
        judged(KEY, None, [(first, NOW), (first, NOW), (second, NOW), (first, NOW), (second, 0)]),
        judged(KEY, None, [(data, NOW) for data in (*strange, first, long, second)]),
        judged(bytes(16), None, [(first, NOW), (sign(b"obey", bytes(16), 7), NOW)]),
        judged(bytes(4096), None, [(sign(b"long key", bytes(4096), 7), NOW)]),
        judged(
            KEY,
            100.0,
            [
                (sign(b"old", KEY, NOW - 101), NOW),
                (sign(b"from tomorrow", KEY, ahead + 1), NOW),
                (sign(b"new", KEY, NOW - 100), NOW),
                (sign(b"newer", KEY, ahead), NOW),
            ],
        ),
    ]
    refused = [say["refused"] for verifier in verifiers for say in verifier["said"]]
    assert {reason and reason[:5] for reason in refused} == {None, "the t", "stale", "made "}
    write_fixture(tmp_path, "verifiers", verifiers)
    run_node_tests("codeAuthenticate", tmp_path)


@pytest.mark.parametrize("key", [None, KEY], ids=["without a key", "with a key"])
def test_messages_are_delivered_alike(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    key: bytes | None,
) -> None:
    monkeypatch.setattr("time.time", lambda: float(NOW))
    texts = [(b"door open", 5), (b"door shut", 6), (b"door open", 5), (b"door shut", 7), (b"x", 8)]
    inbox = Inbox(None, None if key is None else Verifier(key))
    taken = []
    for text, stamp in texts:
        data = sign(text, bytes(16) if text == b"x" else KEY, stamp)
        delivered = inbox.take(Message(data, 4, 3, 0.9, changed=stamp > 5))
        assert inbox.last is not None
        taken.append(
            {
                "data": as_array(data),
                "changed": stamp > 5,
                "delivered": delivered,
                "last": as_array(inbox.last.data),
                "last_changed": inbox.last.changed,
                "refused": inbox.refused,
            }
        )
    capsys.readouterr()
    assert inbox.refused == (0 if key is None else 2)
    fixture = {"key": None if key is None else as_array(key), "now": NOW, "taken": taken}
    write_fixture(tmp_path, "inbox", fixture)
    run_node_tests("codeInbox", tmp_path)
