"""Content of stored files, checked against the types that their readers rely on.

`write_json` stores results, and `checked` turns parsed JSON into dataclasses. `write_sealed` and
`read_sealed` tell a stored line that is as it was written from one that is damaged.
"""

import hashlib
import json
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Annotated, Any, TypeVar

from pydantic import Field, TypeAdapter, ValidationError

from link.errors import InputError
from link.images import write_bytes
from link.outside import MAX_LINES_BYTES, is_file, parse_json, read_bounded

T = TypeVar("T")
Count = Annotated[int, Field(ge=0, le=2**53)]
"""Type of a number of things in a stored file."""
Share = Annotated[float, Field(ge=0, le=1)]
"""Type of a share in a stored file, such as an accuracy."""
Number = Annotated[float, Field(ge=-1e9, le=1e9)]
"""Type of any other number in a stored file; tables and charts can show it."""
DIGEST = "sha256"
"""Key of a sealed line under which its digest stands."""


def checked(kind: type[T], content: Any, where: str) -> T:
    """Turn parsed JSON into the type that its reader relies on.

    Nothing is converted: a text is no number, and 1 is not true. What a dataclass does not name is
    left out.

    Args:
        kind: a dataclass, or a type made of lists, dicts, tuples and dataclasses.
        content: parsed JSON.
        where: file, and line where there are several, for the message of the error.

    Raises:
        InputError: something is missing, or has another type or an impossible value. The message
            names the first such key.

    >>> checked(list[int], [1, 2], "numbers.json")
    [1, 2]
    >>> checked(list[int], [1, "2"], "numbers.json")
    Traceback (most recent call last):
    ...
    link.errors.InputError: numbers.json, 1: Input should be a valid integer
    """
    try:
        adapter = _adapter(kind)  # type: ignore[arg-type]
        value: T = adapter.validate_json(json.dumps(content), strict=True)
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        named = f"{where}, {key:.100}" if key else where
        raise InputError(f"{named}: {first['msg']:.200}") from None
    return value


def write_json(file: Path, content: object) -> None:
    """Write results as strict JSON, with one space of indentation.

    Args:
        file: name of the file; an older one is replaced at once.
        content: dicts, lists, texts, booleans, None, numbers, and dataclasses, which are written
            as objects.

    Raises:
        ValueError: a number is not finite, which strict JSON cannot hold.
        InputError: the file cannot be written.
    """
    text = json.dumps(content, indent=1, default=vars, allow_nan=False)
    write_bytes(file, f"{text}\n".encode())


def seal(line: dict[str, Any]) -> str:
    """Turn a result into a line of JSON, with a digest of its content.

    >>> list(json.loads(seal({"name": "one", "result": 1})))
    ['name', 'result', 'sha256']
    """
    return json.dumps({**line, DIGEST: _digest(line)}, allow_nan=False) + "\n"


def write_sealed(file: Path, lines: Iterable[dict[str, Any]]) -> None:
    """Write lines with a digest in each, unless the file holds just these already."""
    data = "".join(map(seal, lines)).encode()
    if not (is_file(file) and file.read_bytes() == data):
        write_bytes(file, data)


def read_sealed(file: Path) -> list[dict[str, Any]]:
    """Read the lines of a file that are as `seal` wrote them.

    Damaged lines, and one that was cut off by a kill, are left out; so is all of a missing file.
    """
    if not is_file(file):
        return []
    found = []
    for text in read_bounded(file, MAX_LINES_BYTES).split(b"\n"):
        with suppress(InputError):
            line = parse_json(text, str(file))
            if isinstance(line, dict) and line.pop(DIGEST, None) == _digest(line):
                found.append(line)
    return found


def _digest(line: dict[str, Any]) -> str:
    """The first digits of SHA-256 of a line's content: against damage, not against forgery."""
    return hashlib.sha256(json.dumps(line, sort_keys=True).encode()).hexdigest()[:16]


@cache
def _adapter(kind: Any) -> TypeAdapter[Any]:
    """The checks of a type, made once."""
    return TypeAdapter(kind)
