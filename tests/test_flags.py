"""Every number of every command: what cannot be meant ends in one line that names the flag."""

import argparse
import dataclasses
import importlib
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tyro
from conftest import Command

ROOT = Path(__file__).parents[1]
NASTY = ("nan", "inf", "-inf", "1e400", "9" * 23, "9" * 31, "1" + 400 * "0", "9" * 5000)
"""Values that no flag takes."""


def commands() -> list[str]:
    """Every module that reads flags."""
    found = subprocess.run(
        ["git", "grep", "-lw", "read_flags", "--", "*.py", ":!tests", ":!link"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    return [file.removesuffix(".py").replace("/", ".") for file in found.stdout.split()]


class Flags(BaseException):
    """Raised in place of reading the flags: carries what describes them."""

    def __init__(self, described: Any) -> None:
        self.described = described


def described(main: Any, monkeypatch: pytest.MonkeyPatch) -> Any:
    """The parser or the configuration's class of a command."""

    def stop(what: Any, *_: object, **__: object) -> None:
        raise Flags(what)

    with monkeypatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", stop)
        patch.setattr(tyro, "cli", stop)
        patch.setattr(sys, "argv", ["program"])
        with pytest.raises(Flags) as stopped:
            main()
    return stopped.value.described


def numbers_of(flags: Any) -> tuple[list[str], dict[str, tuple[type, int]]]:
    """What a command needs at least, and by flag the kind and count of its numbers."""
    if isinstance(flags, argparse.ArgumentParser):
        needed: list[str] = []
        numbers: dict[str, tuple[type, int]] = {}
        for action in flags._actions:
            if action.required:
                needed += [*action.option_strings[:1], "x"]
            if action.type in (int, float):
                count = action.nargs if isinstance(action.nargs, int) else 1
                numbers[action.option_strings[-1]] = (action.type, count)
        return needed, numbers
    needed = []
    for field in dataclasses.fields(flags):
        if field.default is field.default_factory is dataclasses.MISSING:
            positional = "Positional" in str(field.type)
            needed += ["x"] if positional else [f"--{field.name.replace('_', '-')}", "x"]
    return needed, dict(_numbers_of_fields(flags, ""))


def _numbers_of_fields(kind: Any, prefix: str | None) -> Iterator[tuple[str, tuple[type, int]]]:
    """As `numbers_of`, within a dataclass; ``prefix`` is None where groups are left out."""
    hints = typing.get_type_hints(kind, include_extras=True)
    for field in dataclasses.fields(kind):
        hint, marks = hints[field.name], ""
        if typing.get_origin(hint) is typing.Annotated:
            hint, *rest = typing.get_args(hint)
            marks = repr(rest)
        name = (prefix or "") + field.name.replace("_", "-")
        if dataclasses.is_dataclass(hint):
            omitted = prefix is None or "OmitArgPrefixes" in marks
            yield from _numbers_of_fields(hint, None if omitted else f"{name}.")
        choices = [part for part in typing.get_args(hint) or (hint,) if part is not type(None)]
        if typing.get_origin(choices[0]) is tuple:
            choices = list(typing.get_args(choices[0]))
        if choices[0] in (int, float):
            yield f"--{name}", (choices[0], sum(part in (int, float) for part in choices))


@pytest.mark.parametrize("module", commands())
def test_numbers_that_no_flag_takes(
    module: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    main = importlib.import_module(module).main
    needed, numbers = numbers_of(described(main, monkeypatch))
    for flag, (kind, count) in numbers.items():
        for value in [*NASTY, *["-1"] * (kind is int)]:
            words = [f"{flag}={value}"] if count == 1 else [flag, *[value] * count]
            done = command(main, *needed, *words)
            what = f"{module} {flag} {value:.40}: {done.stderr}"
            assert (done.status, done.stdout, done.stderr.count("\n")) == (2, "", 1), what
            assert done.stderr.startswith(f"error: {flag}: need "), what
            assert len(done.stderr) < 200, what


def test_the_numbers_of_commands_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {}
    for module in ("data_gen.video", "export.send.__main__", "export.parity"):
        main = importlib.import_module(module).main
        found[module] = numbers_of(described(main, monkeypatch))
    assert found["data_gen.video"][0] == ["--out", "x", "--message", "x"]
    video = found["data_gen.video"][1]
    assert (video["--view"], video["--size"], video["--passer-s"]) == (
        (float, 1),
        (int, 2),
        (float, 2),
    )
    assert {"--seed", "--coverage", "--margin-px", "--clock-error"} <= set(video)
    assert found["export.send.__main__"][1]["--counter"] == (int, 1)
    assert found["export.parity"][0] == ["x"]
