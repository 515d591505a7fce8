"""Command lines: flags are read and checked here, and what is wrong is printed in one line."""

import dataclasses
import io
import math
import os
import re
import sys
from argparse import Namespace
from collections.abc import Callable, Iterator, Mapping
from contextlib import redirect_stderr, redirect_stdout, suppress
from itertools import pairwise
from pathlib import Path
from typing import TypeVar

import cv2

from link.errors import InputError, ParameterError

T = TypeVar("T")
MAX_NUMBER = 10**6
"""Largest number, and with a minus the smallest, that a flag takes, if `MAX_OF_FLAG` has no
other."""
MAX_OF_FLAG = {"seed": 2**32 - 1, "jobs": 256, "threads": 256}
"""Largest numbers of flags that many commands have, by the flag's name. Every library that the
project draws from takes seeds of 32 bits."""
MAX_COMPLAINT = 300
"""Number of characters after which a parser's complaint, which may repeat a long value, is cut."""
COLOUR = re.compile(r"\x1b\[[0-9;]*m")
"""Pattern of what makes a terminal change its colour."""
RULE = re.compile(r"^[ │|]*(?:─{4,}|-{4,})[ │|]*$", re.MULTILINE)
"""Pattern of a line that divides a box into sections, with and without Unicode."""
BORDER = re.compile(r"^[│╭╰─ ]+|[│╮╯─ ]+$", re.MULTILINE)
"""Pattern of what stands left and right of a box's text."""
PLAIN_WORDS = (
    (r"invalid literal for int\(\) with base 10: ", "need a whole number, got "),
    (r"could not convert string to float: ", "need a number, got "),
    (r"invalid int value: ", "need a whole number, got "),
    (r"invalid float value: ", "need a number, got "),
    (r"Exceeds the limit .*", "need fewer digits"),
    (
        r"no type matching (?:\{None\}\|)?\{?(.+?)\}? could be instantiated from (\[.*?\])\..*",
        r"need \1, got \2",
    ),
    (r"Could not find valid parse for arguments: ", "need other values, got "),
    (
        r"Could not parse arguments (\[.*\]) into tuple type typing.Tuple",
        r"need other values, got \1 for ",
    ),
    (r"Missing value( for argument '\S+')\. Expected (\d+) values", r"\2 values are missing\1"),
    (r"\b1 values are", "a value is"),
    (r"(\d{10})[\d ]{50,}", r"\1..."),
    (r"\. Expected one of \((.*)\)", r"; choose one of \1"),
)
"""Patterns of what parsers of flags say, each with the words of this project for it."""


NO_MEMORY = re.compile(r"Insufficient memory|can't allocate memory|bad_?alloc", re.IGNORECASE)
"""Pattern of what OpenCV and torch say where memory is used up; they raise no `MemoryError`."""


def run_cli(main: Callable[[], None]) -> None:
    """Run a command's ``main``; what goes wrong outside the program becomes one line on stderr.

    | what | exit status |
    |---|---:|
    | an `InputError`, whatever the system refuses (`OSError`), too little memory | 2 |
    | an interrupt from the keyboard | 130 |
    | nobody reads the output any more, as in ``... | head -1``; nothing is printed | 141 |
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # its descriptor was closed, as by >&-
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):  # some terminals know no κ, and none half of one
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        try:
            main()
        finally:
            sys.stdout.flush()  # a full device or a closed pipe must show here, not at the exit
    except InputError as error:
        said = error.with_flag if isinstance(error, ParameterError) else str(error)
        print_error(said)
        sys.exit(2)
    except KeyboardInterrupt:
        print("interrupted; what was written so far is kept", file=sys.stderr)
        sys.exit(130)
    except BrokenPipeError:
        _drop_output()
        sys.exit(141)  # 128 and the number of SIGPIPE, as a shell says it
    except OSError as error:
        _drop_output()
        where = "the output or a file" if error.filename is None else error.filename
        print_error(f"{where}: {error.strerror or error}")
        sys.exit(2)
    except (MemoryError, RuntimeError, cv2.error) as error:
        if not isinstance(error, MemoryError) and NO_MEMORY.search(str(error)) is None:
            raise
        print_error("too little memory; use smaller sizes or fewer frames")
        sys.exit(2)


def read_flags(read: Callable[[], T], **largest: int) -> T:
    """Read a command's flags with a parser that prints a usage screen or a box where one is wrong.

    What the parser says becomes the message of an `InputError`, in one line that begins with the
    flag; --help prints and exits as usual. What it returns is checked for what no command can work
    with: numbers that are not finite or beyond `MAX_NUMBER`, negative whole numbers, paths without
    a name, and text that is not UTF-8.

    Args:
        read: ``parser.parse_args`` of argparse, or a call of ``tyro.cli``.
        largest: largest numbers by flag, for those that need another bound.

    Returns:
        what ``read`` returns.

    Raises:
        InputError: a flag is unknown, missing or wrong.

    >>> import argparse
    >>> parser = argparse.ArgumentParser()
    >>> _ = parser.add_argument("--frames", type=int)
    >>> read_flags(lambda: parser.parse_args(["--frames", "many"]))
    Traceback (most recent call last):
    ...
    link.errors.InputError: --frames: need a whole number, got 'many'; see --help
    >>> read_flags(lambda: parser.parse_args(["--frames", "9" * 23]))
    Traceback (most recent call last):
    ...
    link.errors.ParameterError: frames: need at most 1000000, got 99999999999999999999999
    """
    printed, answer = _Screen(), _Screen()
    try:
        with redirect_stderr(printed), redirect_stdout(answer):
            flags = read()
    except SystemExit as end:
        if end.code in (None, 0):
            sys.stdout.write(answer.getvalue())  # argparse hides that it cannot be written
            raise
        raise InputError(f"{_complaint(printed.getvalue())}; see --help") from None
    if printed.getvalue():  # warnings of a parser that went on
        sys.stderr.write(printed.getvalue())
    for name, value in _leaves(flags, ""):
        _check_flag(name, value, largest)
    return flags


class _Screen(io.StringIO):
    """Holds what a parser prints, and looks to it like the standard output."""

    def isatty(self) -> bool:
        """Whether a terminal shows the standard output, so that colours are of use."""
        return sys.__stdout__ is not None and sys.__stdout__.isatty()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Encoding of the standard output, on which the shapes of boxes depend."""
        return "utf-8" if sys.__stdout__ is None else sys.__stdout__.encoding


def _complaint(printed: str) -> str:
    """What a parser of flags says is wrong, in one line, and first of all the flag.

    Of argparse it is what follows "error:", of tyro the first section of its box. Wording that is
    not known here is passed on as it stands.
    """
    printed = COLOUR.sub("", printed)
    sections = RULE.split(printed.partition(": error: ")[2] or printed.strip().partition("\n")[2])
    texts = [" ".join(BORDER.sub(" ", section).split()) for section in sections]
    texts = [text for text in texts if text] or ["the flags are wrong"]
    unknown = [rest for text in texts for rest in re.findall(r"^[Uu]nrecogni\w+ \w+: (.*)", text)]
    if unknown:
        meant = [text for text in texts if text.startswith("Perhaps you meant: ")]
        flag = unknown[0].split()[0].strip(",")
        what = "no such flag" if flag.startswith("-") else "one word too many"
        names = re.findall(r"(--\S+) ", meant[0])[:1] if meant else []
        return f"{flag}: {what}" + "".join(f"; perhaps you meant {name}" for name in names)
    said = texts[0]
    missing = re.match(r"Missing from .*?: (\S+) .*\(required\)", said)
    missing = missing or re.match(r"the following arguments are required: ([^\s,]+)", said)
    if missing:
        return f"{missing[1]}: is required"
    for pattern, words in PLAIN_WORDS:
        said = re.sub(pattern, words, said)
    said = re.sub(r"^argument (\S+?/)?(?=\S+: )|^Error parsing (?=--)", "", said)
    group = re.match(r"Error parsing (\w+): (\w+): ", said)
    if group:
        said = f"--{group[1]}.{group[2].replace('_', '-')}: {said[group.end() :]}"
    named = re.search(r" (for argument '(--[\w.-]+)')", said)
    if named:
        said = f"{named[2]}: {said.replace(named[0], '')}"
    said = said.rstrip(".")
    return said if len(said) <= MAX_COMPLAINT else f"{said:.{MAX_COMPLAINT}}..."


def _leaves(flags: object, name: str) -> Iterator[tuple[str, object]]:
    """The values of a namespace or a dataclass, and those within them, each with its name."""
    if isinstance(flags, Namespace):
        inner = list(vars(flags).items())
    elif dataclasses.is_dataclass(flags) and not isinstance(flags, type):
        inner = [(field.name, getattr(flags, field.name)) for field in dataclasses.fields(flags)]
    elif isinstance(flags, list | tuple):
        for value in flags:
            yield from _leaves(value, name)
        return
    else:
        yield name, flags
        return
    for key, value in inner:
        yield from _leaves(value, f"{name}.{key}" if name else key)


def _check_flag(name: str, value: object, largest: Mapping[str, int]) -> None:
    """Raise a `ParameterError` where no flag of any command may have this value."""
    parts = name.split(".")
    given = {word.partition("=")[0].replace("_", "-") for word in sys.argv}
    for start in range(len(parts) - 1):  # the prefixes of groups may be left out
        if f"--{'.'.join(parts[start:]).replace('_', '-')}" in given:
            name = ".".join(parts[start:])
            break
    else:
        name = parts[-1]
    if isinstance(value, int | float) and not isinstance(value, bool):
        high = largest.get(parts[-1], MAX_OF_FLAG.get(parts[-1], MAX_NUMBER))
        got = f"got {value!s:.40}"
        if isinstance(value, float) and not math.isfinite(value):
            raise ParameterError(name, f"need a finite number, {got}")
        if isinstance(value, int) and value < 0:
            raise ParameterError(name, f"need at least 0, {got}")
        if abs(value) > high:
            raise ParameterError(name, f"need at most {high}, {got}")
    flag = f"--{name.replace('_', '-')}"
    shown = flag if flag in given else parts[-1].upper()  # an input that has no flag
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            raise InputError(f"{shown}: not text in UTF-8; check the terminal's encoding") from None
    if isinstance(value, Path) and value == Path() and _is_empty(flag):
        raise InputError(f"{shown}: the name is empty; give the path of a file or folder")


def _is_empty(flag: str) -> bool:
    """Whether a flag, or an input that has none, is an empty text on the command line."""
    if flag in sys.argv:
        return (flag, "") in pairwise(sys.argv)
    return f"{flag}=" in sys.argv or "" in sys.argv


def print_error(said: str) -> None:
    """Print what is wrong on stderr, in one line whatever names of files hold."""
    with suppress(OSError):  # nobody can be told; the status says it
        print(f"error: {' '.join(said.split())}", file=sys.stderr, flush=True)


def _drop_output() -> None:
    """Let the interpreter's last flush of an output that takes nothing more end in silence."""
    with suppress(OSError, ValueError):  # an output that is no file cannot be redirected
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
