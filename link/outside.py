"""What comes from outside: files, JSON and names of files, bounded before anything uses them.

Whoever reads a manifest, a layout, the files of a run, a model's metadata or a value of a command
line reads it through this module. It refuses what would exhaust memory or stack (long files, deep
nesting, numbers of thousands of digits), what strict JSON does not have (NaN and Infinity), and
names that lead out of the folder they belong to.
"""

import json
import math
import os
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from link.errors import InputError

MAX_JSON_BYTES = 16 * 2**20
"""Largest size, in bytes, of one JSON document, or of one line of a file of JSON lines."""
MAX_LINES_BYTES = 512 * 2**20
"""Largest size, in bytes, of a file of JSON lines."""
MAX_DEPTH = 32
"""Largest number of lists and objects that may lie one inside the other."""
MAX_DIGITS = 64
"""Largest number of characters of a whole number."""
SUSPECT = re.compile(rf"\d{{{MAX_DIGITS}}}|[eE]\+?\d{{3}}")
"""Pattern without which no number of a text can be too long or too large."""


def parse_json(text: bytes | str, where: str) -> Any:
    """Read one JSON document.

    Args:
        text: the document; bytes are UTF-8.
        where: where it comes from, such as a file and a line, for the message of the error.

    Returns:
        dicts, lists, texts, finite numbers, booleans and None.

    Raises:
        InputError: not JSON, too long, nested too deep, a number that is not finite or has too
            many digits, half of a character, or a key that one object has twice.

    >>> parse_json('{"view_deg": 45}', "manifest.jsonl, line 1")
    {'view_deg': 45}
    >>> parse_json('{"corners": [[0, NaN]]}', "line 2")
    Traceback (most recent call last):
    ...
    link.errors.InputError: line 2: need finite numbers of at most 64 digits, got NaN
    """
    if len(text) > MAX_JSON_BYTES:
        raise InputError(f"{where}: longer than {MAX_JSON_BYTES} bytes; no such JSON is read")
    if isinstance(text, bytes):
        try:
            text = text.decode("utf-8-sig")  # some editors begin with a mark
        except UnicodeDecodeError:
            raise InputError(f"{where}: not a text file in UTF-8") from None

    def refuse(number: str) -> Any:
        need = f"need finite numbers of at most {MAX_DIGITS} digits"
        raise InputError(f"{where}: {need}, got {number:.40}")

    def whole(number: str) -> int:
        return int(number) if len(number) <= MAX_DIGITS else refuse(number)

    def with_point(number: str) -> float:
        value = float(number)
        return value if math.isfinite(value) else refuse(number)

    def unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) < len(pairs):
            twice = next(name for name, count in Counter(n for n, _ in pairs).items() if count > 1)
            raise InputError(f"{where}: an object has the key {twice!a:.60} twice; keep one")
        return found

    careful = SUSPECT.search(text) is not None  # reading every number in Python is slow
    try:
        value = json.loads(
            text,
            object_pairs_hook=unique,
            parse_constant=refuse,
            parse_int=whole if careful else None,
            parse_float=with_point if careful else None,
        )
        too_deep = text.count("[") + text.count("{") > MAX_DEPTH and _depth(value) > MAX_DEPTH
    except json.JSONDecodeError as error:
        raise InputError(f"{where}: not JSON ({error})") from None
    except RecursionError:
        too_deep = True
    if too_deep:
        raise InputError(f"{where}: lists or objects lie more than {MAX_DEPTH} deep")
    try:
        if "\\ud" in text or "\\uD" in text:
            json.dumps(value, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise InputError(f"{where}: holds half of a character; use UTF-8") from None
    return value


def _depth(value: Any) -> int:
    """The largest number of lists and objects that lie one inside the other."""
    if not isinstance(value, list | dict):
        return 0
    return 1 + max(map(_depth, value.values() if isinstance(value, dict) else value), default=0)


def is_file(path: Path) -> bool:
    """Whether a path leads to a regular file; no path can make this fail.

    A name that no file system takes, such as one of 300 bytes, leads to none; devices and pipes,
    which may never end, are no regular files.
    """
    return os.path.isfile(path)


def is_no_file(path: Path) -> bool:
    """Whether a path leads to something that must not be replaced by a file.

    Folders are such, and devices and pipes: /dev/null would be gone for every program.

    >>> is_no_file(Path("/dev/null")), is_no_file(Path("new.png"))
    (True, False)
    """
    return os.path.exists(path) and not os.path.isfile(path)


def read_bounded(file: Path, max_bytes: int) -> bytes:
    """Read a regular file that may come from a stranger.

    Args:
        file: the file.
        max_bytes: largest size that is read.

    Raises:
        InputError: the file is missing, unreadable or larger.
    """
    if is_no_file(file):
        raise InputError(f"{file}: is a folder or a device; name a file")
    if not is_file(file):
        raise InputError(f"{file}: no such file; check the path")
    try:
        with file.open("rb") as opened:
            data = opened.read(max_bytes + 1)
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror})") from None
    if len(data) > max_bytes:
        raise InputError(f"{file}: larger than {max_bytes} bytes; no such file is read")
    return data


def read_json(file: Path) -> Any:
    """Read a file that holds one JSON document, within the bounds of `parse_json`.

    Raises:
        InputError: the file is missing or unreadable, or its content is refused.
    """
    return parse_json(read_bounded(file, MAX_JSON_BYTES), str(file))


def read_json_lines(file: Path) -> Iterator[tuple[str, Any]]:
    r"""Read a file of JSON lines, each within the bounds of `parse_json`.

    Lines end at ``\n`` alone, as JSON's strings may hold any other character that ends a line
    elsewhere, such as U+2028. Empty lines are passed over.

    Returns:
        for each document where it stands, such as "manifest.jsonl, line 3", and its content.

    Raises:
        InputError: the file is missing or unreadable, or a line is refused.
    """
    for number, line in enumerate(read_bounded(file, MAX_LINES_BYTES).split(b"\n"), 1):
        if line.strip():
            where = f"{file}, line {number}"
            yield where, parse_json(line, where)


def inside(folder: Path, name: object, where: str) -> Path:
    """Find a file that a document names by its path inside a folder.

    Args:
        folder: the folder to which the document belongs.
        name: what the document says: a path relative to ``folder``.
        where: the document and the key, for the message of the error.

    Returns:
        ``folder / name``, which need not exist.

    Raises:
        InputError: not a path, absolute, or it leads out of the folder, be it by a symbolic link.

    >>> inside(Path("captures"), "00000_original.png", "manifest.jsonl, line 1, original").name
    '00000_original.png'
    """
    if not isinstance(name, str) or not name or "\0" in name:
        raise InputError(f"{where}: need the name of a file, got {name!r:.60}")
    path, root = folder / name, os.path.realpath(folder)
    leaves = Path(name).is_absolute() or ".." in Path(name).parts
    if leaves or os.path.commonpath([root, os.path.realpath(path)]) != root:
        raise InputError(f"{where}: {name!r:.100} leads out of {folder}; name a file inside it")
    return path
