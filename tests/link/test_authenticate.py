"""Who sent a message: round trips, changed bytes, other keys, recordings, and bounds."""

import hashlib
import hmac
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from link.code.authenticate import (
    MAX_CLOCK_SKEW_S,
    MAX_KEY_BYTES,
    MAX_STAMP,
    MIN_KEY_BYTES,
    STAMP_BYTES,
    TAG_BYTES,
    SignedMessage,
    Verifier,
    read_key,
    sign,
    verify,
)
from link.errors import InputError

KEY = bytes(range(32))
NOW = 1_800_000_000


@given(st.binary(min_size=1, max_size=200), st.binary(min_size=16, max_size=64), st.data())
def test_round_trip_and_any_changed_byte(message: bytes, key: bytes, data: st.DataObject) -> None:
    stamp = data.draw(st.integers(0, MAX_STAMP))
    signed = sign(message, key, stamp)
    assert len(signed) == len(message) + STAMP_BYTES + TAG_BYTES
    assert verify(signed, key) == SignedMessage(message, stamp)
    at = data.draw(st.integers(0, len(signed) - 1))
    flip = data.draw(st.integers(1, 255))
    changed = signed[:at] + bytes([signed[at] ^ flip]) + signed[at + 1 :]
    assert verify(changed, key) is None
    assert verify(signed[:at], key) is None
    assert verify(signed + b"\0", key) is None
    assert verify(b"\0" + signed, key) is None
    assert verify(signed, bytes([key[0] ^ 1]) + key[1:]) is None


def test_the_tag_is_that_of_the_documented_hmac() -> None:
    protected = b"oorc signed message 1\0" + (7).to_bytes(4, "big") + b"Hello"
    tag = hmac.new(KEY, protected, hashlib.sha256).digest()[:8]
    assert sign(b"Hello", KEY, 7) == b"Hello" + (7).to_bytes(4, "big") + tag


def test_the_tag_is_long_enough_and_compared_in_constant_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert TAG_BYTES >= 8
    compared = []
    monkeypatch.setattr(
        "link.code.authenticate.hmac.compare_digest", lambda a, b: compared.append((a, b))
    )
    verify(sign(b"Hello", KEY, 7), KEY)
    assert len(compared) == 1
    assert len(compared[0][0]) == len(compared[0][1]) == TAG_BYTES


def test_a_signed_message_is_never_empty() -> None:
    with pytest.raises(InputError, match="message: empty"):
        sign(b"", KEY, 1)


def test_recordings_are_stale_and_the_same_message_is_not() -> None:
    verifier = Verifier(KEY)
    first, second = sign(b"door open", KEY, NOW), sign(b"door shut", KEY, NOW + 60)
    assert verifier.judge(first, NOW).refused is None
    assert verifier.judge(first, NOW + 5).refused is None
    assert verifier.judge(second, NOW + 61).refused is None
    replayed = verifier.judge(first, NOW + 70)
    assert replayed.stale
    assert replayed.signed == SignedMessage(b"door open", NOW)
    assert "older than" in replayed.refused
    assert verifier.judge(second, NOW + 80).refused is None


def test_a_forgery_neither_passes_nor_makes_others_stale() -> None:
    verifier = Verifier(KEY)
    forged = sign(b"obey", bytes(16), MAX_STAMP)
    judged = verifier.judge(forged, NOW)
    assert judged.signed is None
    assert not judged.stale
    assert judged.refused is not None
    assert verifier.judge(sign(b"Hello", KEY, 1), NOW).refused is None


def test_old_messages_are_stale_where_there_is_a_largest_age() -> None:
    verifier = Verifier(KEY, max_age_s=100)
    ahead = NOW + MAX_CLOCK_SKEW_S
    assert verifier.judge(sign(b"old", KEY, NOW - 101), NOW).stale
    judged = verifier.judge(sign(b"from tomorrow", KEY, ahead + 1), NOW)
    assert "ahead of this machine's clock" in judged.refused
    assert verifier.judge(sign(b"new", KEY, NOW - 100), NOW).refused is None
    assert verifier.judge(sign(b"newer", KEY, ahead), NOW).refused is None


@pytest.mark.parametrize("age", [0, -1, float("nan"), float("inf"), 1e300])
def test_ages_that_are_none_are_refused(age: float) -> None:
    with pytest.raises(InputError, match="max_age: need more than 0"):
        Verifier(KEY, max_age_s=age)


@pytest.mark.parametrize("stamp", [-1, MAX_STAMP + 1, 10**22])
def test_stamps_have_bounds(stamp: int) -> None:
    with pytest.raises(InputError, match="stamp: need 0 to 4294967295"):
        sign(b"Hello", KEY, stamp)


def test_keys_have_bounds(tmp_path: Path) -> None:
    file = tmp_path / "key"
    for size in (MIN_KEY_BYTES, 32, MAX_KEY_BYTES):
        file.write_bytes(bytes(size))
        assert read_key(file) == bytes(size)
    for size, says in ((0, "got 0"), (MIN_KEY_BYTES - 1, "got 15"), (MAX_KEY_BYTES + 1, "larger")):
        file.write_bytes(bytes(size))
        with pytest.raises(InputError, match=says) as error:
            read_key(file)
        assert len(str(error.value).splitlines()) == 1
        assert str(error.value).startswith(f"key: {file}: ")
    for missing in (tmp_path, tmp_path / "gone", Path("/dev/zero"), tmp_path / ("x" * 300)):
        with pytest.raises(InputError, match="key: "):
            read_key(missing)
    for key in (b"", bytes(15), bytes(4097)):
        with pytest.raises(InputError, match="need 16 to 4096 random bytes"):
            sign(b"Hello", key, 1)
        with pytest.raises(InputError, match="need 16 to 4096 random bytes"):
            Verifier(key)
