"""Command lines: flags are checked here, and what is wrong with an input is printed in one line.

argparse reads the flags of commands that are deployed, and tyro those of all others. Both print
their own help.
"""

import dataclasses
import io
import math
import os
import re
import sys
from argparse import ArgumentParser, ArgumentTypeError, Namespace
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import pairwise
from typing import Any, NoReturn, TypeVar

import cv2

from link import __version__
from link.code.authenticate import MAX_STAMP
from link.errors import InputError, ParameterError
from link.images import MAX_MEGAPIXELS, MEGAPIXELS_VARIABLE, pixel_limit
from link.layout import MAX_PIXELS, MAX_SIDE_PX

T = TypeVar("T")
MAX_NUMBER = 10**6
"""Largest number, and with a minus the smallest, that a flag takes, if `MAX_OF_FLAG` has no
other."""
MAX_OF_FLAG = {
    "seed": 2**32 - 1,
    "jobs": 256,
    "threads": 256,
    "counter": MAX_STAMP,
    "max_age": MAX_STAMP,
}
"""Largest numbers by the flag's name. Every library that the project draws from takes seeds of 32
bits."""
NO_MEMORY = re.compile(r"Insufficient memory|can't allocate memory|bad_?alloc", re.IGNORECASE)
"""Pattern of what OpenCV and torch say where memory is used up; they raise no `MemoryError`."""


def run_cli(main: Callable[[], None]) -> None:
    """Run a command's ``main``; what goes wrong outside the program becomes one line on stderr.

    | what | exit status |
    |---|---:|
    | an `InputError`, whatever the system refuses (`OSError`), too little memory | 2 |
    | an interrupt from the keyboard | 130 |
    | nobody reads the output any more, as in ``... | head -1``; nothing is printed | 141 |

    Every command takes --version by itself, too.
    """
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:  # its descriptor was closed, as by >&-
            setattr(sys, name, open(os.devnull, "w"))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):  # some terminals know no κ, and none half of one
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        try:
            if sys.argv[1:] == ["--version"]:
                print(__version__)
            else:
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


class Parser(ArgumentParser):
    """argparse's parser, whose complaints are an `InputError`, which `run_cli` prints in one line.

    It says, too, where its help cannot be written, which argparse's own hides.

    >>> parser = Parser()
    >>> _ = parser.add_argument("--frames", type=int)
    >>> parser.parse_args(["--frames", "many"])
    Traceback (most recent call last):
    ...
    link.errors.InputError: argument --frames: invalid int value: 'many'; see --help
    """

    def error(self, message: str) -> NoReturn:
        """Raise what argparse would print below the usage of all flags."""
        raise InputError(f"{message}; see --help")

    def print_help(self, file: Any = None) -> None:
        """Print the help to a file, by default to stdout.

        Raises:
            OSError: the file takes no more.
        """
        print(self.format_help(), end="", file=file)


def add_pixel_limit(parser: ArgumentParser) -> None:
    """Give a command the flag --max-megapixels, which sets `link.images.pixel_limit`."""

    def set_limit(text: str) -> str:
        os.environ[MEGAPIXELS_VARIABLE] = text
        try:
            pixel_limit()
        except InputError as error:
            raise ArgumentTypeError(str(error).partition(": ")[2]) from None
        return text

    parser.add_argument(
        "--max-megapixels",
        type=set_limit,
        metavar="N",
        help=f"largest image that is read, in million pixels; {MAX_MEGAPIXELS:g} where absent",
    )


def read_size(text: str) -> tuple[int, int]:
    """Read a size such as 1920x1080, in pixels.

    Raises:
        ArgumentTypeError: the text is no such size, or larger than any display's.
    """
    width, _, height = text.partition("x")
    try:
        size = int(width), int(height)
    except ValueError:
        size = 0, 0
    if not all(1 <= side <= MAX_SIDE_PX for side in size) or size[0] * size[1] > MAX_PIXELS:
        raise ArgumentTypeError(
            f"need WIDTHxHEIGHT in pixels, such as 1920x1080, each up to {MAX_SIDE_PX}, with up to "
            f"{MAX_PIXELS:,} in all, got {text:.40}"
        )
    return size


def check_flags(flags: T) -> T:
    """Check what argparse or tyro have read from the command line.

    Args:
        flags: a namespace of argparse, or a dataclass that tyro made.

    Returns:
        ``flags`` as they are.

    Raises:
        InputError: a text is empty or not UTF-8, or a number is not finite, beyond `MAX_NUMBER`, or
            whole and negative.
    """
    for before, word in pairwise(sys.argv):
        if not word or (word.startswith("--") and word.endswith("=")):
            flag = word[:-1] or (before if before.startswith("--") else "an input")
            raise InputError(f"{flag}: empty; give a name, a number or a text")
    for name, value in _leaves("", flags):
        _check_value(name, value)
    return flags


def _leaves(name: str, value: object) -> Iterator[tuple[str, object]]:
    """The values of a namespace or a dataclass, and those within them, by names such as ".a.b"."""
    if isinstance(value, Namespace) or dataclasses.is_dataclass(value):
        for key, inner in vars(value).items():
            yield from _leaves(f"{name}.{key}", inner)
    elif isinstance(value, list | tuple):
        for inner in value:
            yield from _leaves(name, inner)
    else:
        yield name, value


def _check_value(name: str, value: object) -> None:
    """Raise an `InputError` where no flag of any command may have this value.

    Args:
        name: names of a flag's groups and of the flag, each after a point.
        value: value of the flag.
    """
    flag = _flag_as_given(name)
    if isinstance(value, int | float):
        high = MAX_OF_FLAG.get(name.rpartition(".")[2], MAX_NUMBER)
        low = 0 if isinstance(value, int) else -high
        if not low <= value <= high:
            need = f"at most {high}" if value > low else f"at least {low}"
            if isinstance(value, float) and not math.isfinite(value):
                need = "a finite number"
            raise InputError(f"{flag}: need {need}, got {value!s:.40}")
    if isinstance(value, str):
        try:
            value.encode()
        except UnicodeEncodeError:
            raise InputError(f"{flag}: not text in UTF-8; check the terminal's encoding") from None


def _flag_as_given(name: str) -> str:
    """Find the flag on the command line, where prefixes of groups may be left out.

    An input that has no flag is named in capitals, as --help names it.
    """
    dashed = name.replace("_", "-")
    words = (word.partition("=")[0].replace("_", "-") for word in sys.argv)
    flags = [word for word in words if word[:2] == "--" and dashed.endswith(f".{word[2:]}")]
    return max(flags, key=len, default=dashed.rpartition(".")[2].upper())


def print_error(said: str) -> None:
    """Print what is wrong on stderr, in one line whatever names of files hold.

    Characters that steer a terminal are escaped, and so are those that nobody sees.
    """
    said = " ".join(said.split())
    line = "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in said)
    with suppress(OSError):  # nobody can be told; the status says it
        print(f"error: {line}", file=sys.stderr, flush=True)


def _drop_output() -> None:
    """Let the interpreter's last flush of an output that takes nothing more end in silence."""
    with suppress(OSError, ValueError):  # an output that is no file cannot be redirected
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
