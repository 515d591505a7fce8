"""Every number of every command: what cannot be meant ends in one line that names the flag."""

import argparse
import dataclasses
import importlib
import re
import subprocess
import sys
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import tyro
from conftest import ROOT, Command, cases, slow

from lab.__main__ import STUDIES
from link import __version__
from link.cli import read_flags
from link.cli.help import usual_help
from link.errors import InputError

NASTY = ("nan", "inf", "-inf", "1e400", "9" * 23, "9" * 31, "1" + 400 * "0", "9" * 5000)
"""Values that no flag takes."""


def commands() -> list[str]:
    """Every module that reads flags, and of the lab every study, in words of a command line."""
    found = subprocess.run(
        ["git", "grep", "-lw", "read_flags", "--", "*.py", ":!tests", ":!link"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
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


@pytest.mark.parametrize("share", [len(NASTY), slow(1)])
@pytest.mark.parametrize("name", commands())
def test_numbers_that_no_flag_takes(
    name: str, share: int, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every flag with every value; soon, each flag with one value of these in turn."""
    module, *study = name.split()
    main = importlib.import_module(module).main
    needed, numbers = numbers_of(described(main, monkeypatch, *study))
    for number, (flag, (kind, count)) in enumerate(numbers.items()):
        for value in [*NASTY[number % share :: share], *["-1"] * (kind is int)]:
            words = [f"{flag}={value}"] if count == 1 else [flag, *[value] * count]
            done = command(main, *study, *needed, *words)
            what = f"{name} {flag} {value:.40}: {done.stderr}"
            assert (done.status, done.stdout, done.stderr.count("\n")) == (2, "", 1), what
            assert done.stderr.replace("_", "-").startswith(f"error: {flag}: "), what
            assert len(done.stderr) < 400, what


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


def test_whatever_a_parser_says_becomes_one_line(command: Command) -> None:
    for module, words, says in (
        (
            "data_gen.__main__",
            "--fram 3 --out x",
            "Unrecognized options: --fram, 3; perhaps you meant --frames",
        ),
        ("data_gen.__main__", "", "Missing from program: --out PATH "),
        ("data_gen.__main__", "--out x y", "Unrecognized options: y"),
        (
            "data_gen.__main__",
            "--out x --frames",
            "Missing value for argument '--frames'. Expected 1 values",
        ),
        ("data_gen.__main__", "--out x --frames 1.5", "--frames: need a whole number, got '1.5'"),
        (
            "data_gen.video",
            "--out x --message a --size 3",
            "Missing value for argument '--size'. Expected 2 values",
        ),
        (
            "data_gen.video",
            "--out x --message a --passer-s 3",
            "--passer-s: no type matching {None}|{FLOAT FLOAT} could be instantiated from ['3']",
        ),
        (
            "data_gen.video",
            "--out x --message a --window x",
            "invalid choice 'x' for argument '--window'. Expected one of ",
        ),
        ("train", "--decoder.coarsen 3", "--decoder.coarsen: need 1 or 2, got 3"),
        ("export.parity", "", "Missing from program: PATH "),
        (
            "export.receive.__main__",
            "",
            "the following arguments are required: INPUT",
        ),
        ("export.receive.__main__", "x --bogus", "unrecognized arguments: --bogus"),
        (
            "export.receive.__main__",
            "x --threads many",
            "--threads: need a whole number, got 'many'",
        ),
        ("export.runtime", "m a b --corners 0,0", "--corners: expected 4 arguments"),
    ):
        done = command(importlib.import_module(module).main, *words.split())
        assert (done.status, done.stdout) == (2, "")
        assert done.stderr.startswith(f"error: {says}"), done.stderr
        assert done.stderr.endswith("; see --help\n") and done.stderr.count("\n") == 1


def test_words_of_a_parser_that_are_not_known_are_passed_on_in_one_line() -> None:
    def read() -> None:
        print(" Oh\n ----\n The\n moon\n\n is\n ----\n more", file=sys.stderr)
        raise SystemExit(2)

    with pytest.raises(InputError, match=r"^The moon; see --help$"):
        read_flags(read)


@pytest.mark.parametrize("module", ["data_gen.__main__", "export.send.__main__"])
def test_help_is_printed(module: str, command: Command) -> None:
    done = command(importlib.import_module(module).main, "--help")
    assert (done.status, done.stderr) == (0, "")
    assert "--kappa" in done.stdout and done.stdout.count("\n") > 20
    assert not re.search(r"\{None\}|\(default: \)|-----", done.stdout)


def test_flags_of_the_layout_come_last_and_those_that_must_be_given_first() -> None:
    printed = (
        "usage: x.py [-h] [OPTIONS]\n\nDoes\n100 % of it.\n\n options   \n -------------------- \n"
        "  -h, --help   show this help\n  --rows INT   Rows. (default: 8)\n"
        "  --names {None}|{[STR [STR ...]]}   \n      Names, as in\n      'a'. (default: None)\n"
        "  --out PATH   Folder. (required)\n"
    )
    said = usual_help(printed)
    order = ["Does 100 % of it.", "options:\n", "--out PATH", "--help", "--names [STR ...]"]
    order += ["in other commands", "--rows INT"]
    assert sorted(order, key=said.index) == order
    assert "Names, as in 'a'." in said and "None" not in said


def test_every_command_says_its_version(command: Command) -> None:
    done = command(importlib.import_module("export.locate.__main__").main, "--version")
    assert (done.status, done.stdout) == (0, f"{__version__}\n")


@cases(
    ("data_gen.__main__", ["--out", ""], "--out: empty; give a name"),
    ("data_gen.__main__", ["--out="], "--out: empty; give a name"),
    ("export.parity", [""], "an input: empty; give a name"),
    ("export.receive.__main__", [""], "an input: empty; give a name"),
    ("export.receive.__main__", ["²"], "²: no such folder, video file or camera number"),
    ("export.send.__main__", ["x", "--message", "\udcff", "--out", "y"], "--message: not text"),
    ("data_gen.video", ["--message", "\udcff", "--out", "y"], "--message: not text in UTF-8"),
    ("export.locate.__main__", ["a\nb"], "a b: no such image file"),
    ("export.locate.__main__", ["n" * 300], "n" * 300),
    ("export.receive.__main__", ["n" * 300], "n" * 300),
    ("export.send.__main__", ["x", "--message", "a", "--out", "n" * 300], "n" * 300),
    ("data_gen.__main__", ["--out", "n" * 300], "n" * 300),
    ("data_gen.video", ["--message", "a", "--out", "x", "--size", "9000", "9000"], "--size: "),
    ("data_gen.video", ["--message", "a", "--out", "x", "--shown", "99999"], "--shown: "),
)
def test_names_and_texts_that_cannot_be(
    module: str, words: list[str], says: str, command: Command, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command(importlib.import_module(module).main, *words)
    assert (done.status, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert done.stderr.startswith(f"error: {says}")


@cases(
    ("lab.__main__", ["delivery", "--views", "1000000"], "--views: need an angle"),
    ("lab.__main__", ["delivery", "--kappa", "1000"], "--kappa: need 1 to 64"),
    ("lab.__main__", ["delivery", "--kappa", "0"], "--kappa: need 1 to 64"),
    ("lab.__main__", ["delivery", "--n-bytes", "100000"], "--n-bytes: 100000 bytes"),
    ("lab.__main__", ["delivery", "--coverage", "0", "0.5"], "--coverage: need a share"),
    ("lab.__main__", ["delivery", "--coverage", "0.5", "0.4"], "--coverage: the largest"),
    ("lab.__main__", ["delivery", "--fps", "0"], "--fps: need"),
    ("lab.__main__", ["delivery", "--state-hz", "1e5"], "--state-hz: need"),
    ("lab.__main__", ["delivery", "--loops", "0"], "--loops: need more than 0"),
    ("lab.__main__", ["delivery", "--grid", "9"], "--grid: need 8 or 16"),
    ("lab.__main__", ["delivery", "--pairs", "x"], "unknown name in --pairs 'x'"),
    ("lab.__main__", ["delivery", "--codec.name", "vp9"], "--codec.name: need none, h264"),
    ("lab.__main__", ["delivery", "--codec.kbits", "1"], "--codec.kbits: need 50 to 500000"),
    ("lab.__main__", ["delivery", "--drop", "1"], "--drop: need a probability"),
    ("lab.__main__", ["delivery", "--noise-reduction", "1"], "--noise-reduction: need 0"),
    ("lab.__main__", ["codecs", "--variants", "x"], "unknown name in --variants 'x'"),
    ("lab.__main__", ["codecs", "--variants", "tones", "tones"], "--variants: name at least one"),
    ("lab.__main__", ["codecs", "--kappas", "0"], "--kappas: need 1 to 64"),
    ("lab.__main__", ["codecs", "--preset", "x"], "unknown preset 'x'"),
    ("lab.__main__", ["codecs", "--views", "90"], "--views: need an angle"),
    ("lab.__main__", ["codecs", "--n-bytes", "100000"], "--n-bytes: 100000 bytes"),
    ("lab.__main__", ["locate", "--size", "1000000", "1000000"], "--size: 1000000x1000000"),
    ("lab.__main__", ["locate", "--size", "8", "8"], "--size: need at least 64x64"),
    ("lab.__main__", ["visibility", "--limit", "0"], "--limit: need a number above 0"),
    ("lab.__main__", ["flicker", "--width", "1000000"], "layout: a 1000000x384 frame"),
    ("lab.__main__", ["flicker", "--seconds", "1000000"], "--seconds: need 1 to 3600"),
)
def test_studies_refuse_a_number_out_of_range_before_any_work(
    module: str, words: list[str], says: str, command: Command, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    done = command(importlib.import_module(module).main, *words)
    assert (done.status, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert done.stderr.startswith(f"error: {says}")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("module", ["data_gen.__main__", "data_gen.video", "evaluate"])
@pytest.mark.parametrize("folder", ["missing", "n" * 300])
def test_a_wrong_folder_of_pictures_is_all_that_is_printed(
    module: str, folder: str, command: Command, tmp_path: Path, monkeypatch: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["--message", "a"] if module == "data_gen.video" else []
    done = command(importlib.import_module(module).main, "--pictures", folder, "--out", "x", *words)
    assert (done.status, done.stdout, done.stderr.count("\n")) == (2, "", 1), done.stderr
    assert done.stderr.startswith(f"error: {folder}: ")
    assert not list(tmp_path.iterdir())
