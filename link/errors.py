"""The one exception for input that the user can mend, and the wrapper that prints it."""

import sys
from collections.abc import Callable, Mapping, Sequence
from typing import TypeVar

T = TypeVar("T")


class InputError(ValueError):
    """Input from outside is wrong; the message says what, and what to do, in one line."""


class UnsuitedError(InputError):
    """A frame pair lacks what a method needs, such as ratex patches; other methods may do."""


def run_cli(main: Callable[[], None]) -> None:
    """Run a command's ``main``; an `InputError` becomes one line on stderr and exit status 2."""
    try:
        main()
    except InputError as error:
        print(f"error: {' '.join(str(error).split())}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print("interrupted; what was written so far is kept", file=sys.stderr)
        sys.exit(130)


def choose(choices: Mapping[str, T], name: str, what: str) -> T:
    """``choices[name]``, or an `InputError` that lists the valid names of ``what``."""
    if name not in choices:
        raise InputError(f"unknown {what} {name!r}; choose one of: {', '.join(choices)}")
    return choices[name]


def at_least(low: int, **flags: int) -> None:
    """Raise an `InputError` that names the first flag whose value is below ``low``."""
    for name, value in flags.items():
        if not value >= low:
            raise InputError(f"--{name.replace('_', '-')}: need at least {low}, got {value}")


def each_once(**flags: Sequence[object]) -> None:
    """Raise an `InputError` that names the first flag with no value, or with one value twice."""
    for name, values in flags.items():
        if not values or len(set(values)) != len(values):
            raise InputError(f"--{name}: name at least one, and none twice")
