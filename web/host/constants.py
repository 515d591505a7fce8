"""Write the constants that the page shares with Python: generated/constants.js, and events.d.ts.

Every constant of these modules stands in Python alone. The file has one object for each module,
with its constants under their Python names, each with its docstring as its comment. The bundle
takes what the page's JavaScript names. The page's build and the tests write the file; it is not
kept in the repository.
"""

import ast
import json
from collections.abc import Iterator
from importlib import import_module
from inspect import cleandoc
from pathlib import Path
from typing import Any

import numpy as np

from link.images import write_bytes
from link.modules import ROOT
from web.package.schema import events_types

GENERATED = ROOT / "web" / "generated" / "constants.js"
"""The file of constants."""
EVENTS = GENERATED.with_name("events.d.ts")
"""The file of the types of events."""
SHARED = [
    ".".join(file.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
    for place in (
        "link/[a-z]*",
        "link/*/*",
        "models/film/window",
        "models/pairwise",
        "models/region/__init__",
        "receiver/**/*",
        "sender/carrying",
        "sender/compact",
        "sender/pictures",
        "web/host/tables",
    )
    for file in sorted(ROOT.glob(f"{place}.py"))
    if file.name != "__main__.py"
]
"""Names of the modules whose constants the page may share, by where they lie."""
LONGEST_TUPLE = 4
"""Largest number of entries that a tuple of numbers may have to be of a fixed length to the page's
types; longer ones are arrays of any length."""


def write_constants() -> None:
    """Write constants and the types of events anew, unless the files hold them already."""
    parts = [
        "/**",
        " * Constants that the page shares with Python, by the module that defines them.",
        " *",
        " * Written by web/host/constants.py; change them in Python.",
        " */",
    ]
    for module in SHARED:
        parts += ["", f"export const {object_name(module)} = {{"]
        for name, value, text in constants_of(module):
            lines = text.splitlines()
            parts += ["  /**", *(f"   * {line}".rstrip() for line in lines)]
            parts += ["   *", f"   * @type {{{js_type(value)}}}", "   */"]
            parts.append(f"  {name}: {js_value(value)},")
        parts.append("};")
    written = {GENERATED: "\n".join(parts) + "\n", EVENTS: events_types()}
    for file, text in written.items():
        if not file.is_file() or file.read_text("utf-8") != text:
            write_bytes(file, text.encode())


def object_name(module: str) -> str:
    """Name of the object that holds a module's constants; those of `link` lack its name.

    >>> object_name("link.code.fine"), object_name("receiver.pilots.search.window_search")
    ('codeFine', 'receiverPilotsSearchWindowSearch')
    """
    first, *words = module.removeprefix("link.").replace("_", ".").split(".")
    return first + "".join(word.capitalize() for word in words)


def constants_of(module: str) -> Iterator[tuple[str, Any, str]]:
    """Give the public constants of a module that JavaScript can hold.

    Yields:
        name, value and docstring of each, in the module's order. Of names that are assigned
        together, all have the docstring that follows.
    """
    loaded = import_module(module)
    assert loaded.__file__ is not None
    body = ast.parse(Path(loaded.__file__).read_text("utf-8")).body
    for statement, after in zip(body, [*body[1:], ast.Pass()], strict=True):
        if not isinstance(statement, ast.Assign):
            continue
        target = statement.targets[0]
        names = target.elts if isinstance(target, ast.Tuple) else [target]
        described = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
        text = cleandoc(str(after.value.value)) if described else ""  # type: ignore[attr-defined]
        for name in names:
            if isinstance(name, ast.Name) and name.id.isupper() and not name.id.startswith("_"):
                value = plain(getattr(loaded, name.id))
                if value is not None:
                    yield name.id, value, text


def plain(value: Any) -> Any:
    """Turn a constant into numbers, texts, tuples, lists and dicts; None where it is more."""
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, tuple | list):
        entries = [plain(entry) for entry in value]
        if None in entries:
            return None
        return tuple(entries) if isinstance(value, tuple) else entries
    if isinstance(value, dict):
        if not all(isinstance(key, int | float | str) for key in value):
            return None
        pairs = {key: plain(entry) for key, entry in value.items()}
        return None if None in pairs.values() else pairs
    return value if isinstance(value, bool | int | float | str) else None


def js_value(value: Any) -> str:
    """Write a plain value as JavaScript; dicts become maps.

    >>> js_value({1: (0.5, True, float("inf"))})
    'new Map([[1, [0.5, true, Infinity]]])'
    """
    if isinstance(value, dict):
        pairs = ", ".join(f"[{js_value(key)}, {js_value(held)}]" for key, held in value.items())
        return f"new Map([{pairs}])"
    if isinstance(value, tuple | list):
        return f"[{', '.join(map(js_value, value))}]"
    return json.dumps(value)


def js_type(value: Any) -> str:
    """Name the type of a plain value for TypeScript.

    >>> js_type(((0.5, 2), (1.0, 3)))
    '[number, number][]'
    """
    if isinstance(value, dict):
        key, held = next(iter(value.items()))
        return f"Map<{js_type(key)}, {js_type(held)}>"
    if isinstance(value, tuple | list):
        kinds = [js_type(entry) for entry in value]
        same = len(set(kinds)) == 1
        fixed = isinstance(value, tuple) and len(value) <= LONGEST_TUPLE
        if fixed and not (same and kinds[0] != "number"):
            return f"[{', '.join(kinds)}]"
        return f"{kinds[0]}[]" if same else f"({' | '.join(dict.fromkeys(kinds))})[]"
    if isinstance(value, bool):
        return "boolean"
    return "string" if isinstance(value, str) else "number"
