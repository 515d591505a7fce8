"""Every number of every command: what cannot be meant ends in one line that names the flag."""

import argparse
import dataclasses
import importlib
import sys
import typing
from collections.abc import Iterator
from typing import Any

import pytest
import tyro
from conftest import Command, Refuses, cases, run_process, slow

from lab.__main__ import STUDIES
from link import __version__

NASTY = ("nan", "inf", "-inf", "1e400", "9" * 23, "9" * 31, "1" + 400 * "0", "9" * 5000)
"""Values that no flag takes."""
FILM = "--message a --out x"
"""What a film needs."""


def commands() -> list[str]:
    """Every module that reads flags, and of the lab every study, in words of a command line."""
    found = run_process("git", "grep", "-lw", "check_flags", "--", "*.py", ":!tests", ":!link")
    modules = [file.removesuffix(".py").replace("/", ".") for file in found.stdout.split()]
    modules.remove("lab.study")
    return [*modules, *(f"lab.__main__ {name}" for name in STUDIES)]


class Flags(BaseException):
    """Raised in place of reading the flags: carries what describes them."""

    def __init__(self, described: Any) -> None:
        self.described = described


def described(main: Any, monkeypatch: pytest.MonkeyPatch, *words: str) -> Any:
    """The parser or the configuration's class of a command that begins with some words."""

    def stop(what: Any, *_: object, **__: object) -> None:
        raise Flags(what)

    with monkeypatch.context() as patch:
        patch.setattr(argparse.ArgumentParser, "parse_args", stop)
        patch.setattr(tyro, "cli", stop)
        patch.setattr(sys, "argv", ["program", *words])
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


@pytest.mark.parametrize(
    "name", [slow(name) if name == "data_gen.video" else name for name in commands()]
)
def test_numbers_that_no_flag_takes(
    name: str, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each flag with one value of these in turn."""
    module, *study = name.split()
    main = importlib.import_module(module).main
    needed, numbers = numbers_of(described(main, monkeypatch, *study))
    for number, (flag, (kind, count)) in enumerate(numbers.items()):
        for value in [NASTY[number % len(NASTY)], *["-1"] * (kind is int)]:
            words = [f"{flag}={value}"] if count == 1 else [flag, *[value] * count]
            done = command(main, *study, *needed, *words, status=2)
            what = f"{name} {flag} {value:.40}: {done.stderr}"
            assert done.stdout == "" and "Traceback" not in done.stderr, what
            said = done.stderr.replace("_", "-")
            assert flag in said or flag[2:].replace(".", ": ") in said, what


def test_the_numbers_of_commands_are_found(monkeypatch: pytest.MonkeyPatch) -> None:
    found = {}
    for module in ("data_gen.video", "sender.__main__", "export.parity"):
        main = importlib.import_module(module).main
        found[module] = numbers_of(described(main, monkeypatch))
    assert found["data_gen.video"][0] == ["--out", "x", "--message", "x"]
    video = found["data_gen.video"][1]
    assert (video["--view"], video["--size"]) == ((float, 1), (int, 2))
    assert {"--seed", "--coverage", "--margin-px", "--clock-error"} <= set(video)
    assert found["sender.__main__"][1]["--counter"] == (int, 1)
    assert found["export.parity"][0] == ["x"]


@cases(
    ("data_gen.__main__", "--fram 3 --out x", "--fram"),
    ("data_gen.__main__", "--out x --frames", "--frames"),
    ("data_gen.video", f"{FILM} --size 3", "--size"),
    ("lab.__main__", "rates --nothing", "--nothing"),
    ("receiver.__main__", "", "error: the following arguments are required: INPUT; see --help\n"),
    ("receiver.__main__", "x --bogus", "error: unrecognized arguments: --bogus; see --help\n"),
    ("export.runtime", "m a b --corners 0,0", "error: argument --corners: expected 4 arguments"),
)
def test_what_a_parser_refuses_names_the_flag(
    module: str, words: str, says: str, command: Command
) -> None:
    done = command(importlib.import_module(module).main, *words.split(), status=2)
    assert done.stdout == ""
    assert says in done.stderr and "Traceback" not in done.stderr


@pytest.mark.parametrize("module", ["data_gen.__main__", "sender.__main__"])
def test_help_is_printed(module: str, command: Command) -> None:
    done = command(importlib.import_module(module).main, "--help")
    assert done.stderr == ""
    assert "--kappa" in done.stdout and done.stdout.count("\n") > 20


def test_every_command_says_its_version(command: Command) -> None:
    done = command(importlib.import_module("receiver.locate.__main__").main, "--version")
    assert done.stdout == f"{__version__}\n"


LONG = "n" * 300


@cases(
    ("data_gen.__main__", ["--out", ""], "--out: empty; give a name"),
    ("receiver.__main__", [""], "an input: empty; give a name"),
    ("receiver.__main__", "²", "²: no such folder, video file, camera number or device"),
    ("sender.__main__", "x --message \udcff --out y", "--message: not text"),
    ("data_gen.video", "--message \udcff --out y", "--message: not text in UTF-8"),
    ("receiver.locate.__main__", ["a\nb"], "a b: no such image file"),
    ("sender.__main__", f"x --message a --out {LONG}", LONG),
    ("data_gen.__main__", f"--out {LONG}", LONG),
    *(
        (module, f"--pictures {folder} --out x {words}", f"{folder}: ")
        for module, words in (("data_gen.__main__", ""), ("data_gen.video", FILM), ("evaluate", ""))
        for folder in ("missing", LONG)
    ),
)
def test_names_and_texts_that_cannot_be(
    module: str, words: str | list[str], says: str, refuses: Refuses
) -> None:
    refuses(module, words, f"error: {says}")


@cases(
    ("x", "unknown study 'x'; choose one of: "),
    ("rates --jobs 0", "--jobs: need at least 1"),
    ("rates --views 1000000", "--views: need an angle"),
    ("rates --n-bytes 100000", "--n-bytes: 100000 bytes"),
    ("rates --pairs x", "unknown name in --pairs 'x'"),
    ("rates --settings paper paper", "--settings: name at least one, and none twice"),
    ("ablation --conditions rain", "unknown name in --conditions 'rain'; choose one of"),
    ("ablation --rows phi+magic", "unknown name in --rows 'phi+magic'; choose one of: oorc, phi, "),
    ("ablation --run nowhere", "--run: nowhere"),
)
def test_a_study_refuses_a_wrong_word_before_any_work(
    words: str, says: str, refuses: Refuses
) -> None:
    refuses("lab.__main__", words, f"error: {says}")
