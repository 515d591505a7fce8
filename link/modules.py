"""The modules of the checkout and what they import, for what packs them and digests of code."""

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]
"""Folder of the checkout."""


def imported_modules(modules: Sequence[str], root: Path = ROOT) -> list[str]:
    """List modules and all modules below ``root`` that they import, wherever the import stands.

    Args:
        modules: dotted names.
        root: folder that holds the packages.

    >>> "link.ratex" in imported_modules(["models.paper.oorc"])
    True
    >>> "sender.player" in imported_modules(["models.paper.oorc"])
    False
    """
    found: set[str] = set()
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module not in found and module_file(module, root).is_file():
            found.add(module)
            waiting += _imports(module, root)
    return sorted(found)


def module_file(module: str, root: Path = ROOT) -> Path:
    """Give the path that the file of a module has if the module lies below ``root``."""
    place = root / module.replace(".", "/")
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


def _imports(module: str, root: Path) -> Iterator[str]:
    """Give names that may be modules, from every import statement of a module."""
    for node in ast.walk(ast.parse(module_file(module, root).read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))
