"""What a user can mend, in one line: exceptions, and checks that raise them."""

from collections.abc import Iterable, Mapping, Sequence
from typing import TypeVar

T = TypeVar("T")


class InputError(ValueError):
    """Input from outside is wrong; the message says what, and what to do, in one line."""

    code: str = "input"
    """Code of the kind of error, for programs: one of those that docs/embed.md lists, or ``input``
    where no other fits."""


class ParameterError(InputError):
    """One parameter of a function, or the flag of that name of a command, has a wrong value.

    The library names the parameter, because its callers write Python. A command line names the
    flag, because its users never see the parameter: `run_cli` prints `with_flag`.

    Args:
        parameter: name of the parameter, such as ``max_view``. A name that begins with two
            dashes is taken to be a flag already.
        problem: what is wrong with the value, and what to do.

    >>> error = ParameterError("max_view", "need more than 0, got -1")
    >>> str(error)
    'max_view: need more than 0, got -1'
    >>> error.with_flag
    '--max-view: need more than 0, got -1'
    """

    def __init__(self, parameter: str, problem: str) -> None:
        super().__init__(f"{parameter}: {problem}")  # tyro prints the first argument alone
        self.parameter = parameter
        self.problem = problem

    def __reduce__(self) -> tuple[type["ParameterError"], tuple[str, str]]:
        """Tell pickle both arguments, so that a process may send the error to another."""
        return ParameterError, (self.parameter, self.problem)

    @property
    def with_flag(self) -> str:
        """The message for users of a command line, with the flag in place of the parameter."""
        if self.parameter.startswith("--"):
            return str(self)
        return f"--{self.parameter.replace('_', '-')}: {self.problem}"


class UnsuitedError(InputError):
    """A frame pair lacks what a method needs, such as ratex patches; other methods may do."""


class NoDisplayError(InputError):
    """Two images do not show both states of one display."""

    code = "no-display"


def choose(choices: Mapping[str, T], name: str, what: str) -> T:
    """Look up a name that a user gave.

    Args:
        choices: values by their names.
        name: the name to look up.
        what: what is chosen, for the message, such as "decoder".

    Returns:
        ``choices[name]``.

    Raises:
        InputError: the name is unknown; the message lists those that are known.
    """
    if not isinstance(name, str) or name not in choices:
        raise InputError(f"unknown {what} {name!r}; choose one of: {', '.join(choices)}")
    return choices[name]


def at_least(low: int, **parameters: int) -> None:
    """Raise a `ParameterError` that names the first parameter whose value is below ``low``.

    >>> at_least(1, frames=4, jobs=0)
    Traceback (most recent call last):
    ...
    link.errors.ParameterError: jobs: need at least 1, got 0
    """
    for name, value in parameters.items():
        if not value >= low:
            raise ParameterError(name, f"need at least {low}, got {value}")


def in_range(settings: object, **limits: tuple[float, float, str]) -> None:
    """Raise a `ParameterError` that names the first field of settings that is out of its range.

    Args:
        settings: holds the fields; one that is None is in range.
        limits: by the name of a field its least and its largest value, and the unit in words, with
            a space before it where it has one.

    >>> from types import SimpleNamespace
    >>> in_range(SimpleNamespace(fps=0.0), fps=(0.1, 1000, " a second"))
    Traceback (most recent call last):
    ...
    link.errors.ParameterError: fps: need 0.1 to 1000 a second, got 0
    """
    for name, (low, high, unit) in limits.items():
        value = getattr(settings, name)
        if value is not None and not low <= value <= high:
            raise ParameterError(name, f"need {low:g} to {high:g}{unit}, got {value:g}")


def each_once(**parameters: Sequence[object]) -> None:
    """Raise a `ParameterError` that names the first list that is empty or repeats a value."""
    for name, values in parameters.items():
        if not values or len(set(values)) != len(values):
            raise ParameterError(name, "name at least one, and none twice")


def each_known(choices: Iterable[str], **parameters: Sequence[str]) -> None:
    """Raise an `InputError` where a list of a command names what is not known, or one twice.

    Args:
        choices: known names.
        parameters: names that a user gave, by the name of the parameter that holds them.

    >>> each_known(["paper", "hidden"], presets=["loud"])
    Traceback (most recent call last):
    ...
    link.errors.InputError: unknown name in --presets 'loud'; choose one of: paper, hidden
    """
    for parameter, names in parameters.items():
        for name in names:
            choose(dict.fromkeys(choices), name, f"name in --{parameter}")
    each_once(**parameters)
