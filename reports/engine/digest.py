"""Digests of what decides a result: the code that it really runs, files, and installed packages.

Stored results are named after such a digest, so that a run goes on where it was cut off, and starts
anew where something changed that matters. Comments, docstrings and modules that are not imported do
not matter.
"""

import ast
import hashlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).parents[2]
"""Folder of the checkout."""
PACKAGES = ("numpy", "scipy", "opencv-python-headless", "scikit-image", "scikit-learn", "torch")
"""Installed packages that decide what a decoder answers, up to the processor's rounding."""
DATA = {"data_gen.pairs": ("data_gen/nuisances.json",)}
"""Files that a module reads when it is imported, beside its code."""


def file_digest(files: Iterable[Path]) -> str:
    """SHA-256 of the files' content, in the order given; a missing file counts as such."""
    digest = hashlib.sha256()
    for file in files:
        digest.update(file.read_bytes() if file.is_file() else b"missing")
    return digest.hexdigest()


@lru_cache(maxsize=64)
def code_digest(*modules: str, root: Path = ROOT) -> str:
    """SHA-256 of these modules of ours, and of all modules of ours that they import.

    Only the statements count: comments, docstrings and layout may change. Read once a process, so
    that a worker that runs on keeps the code with which it started.

    Args:
        *modules: dotted names, such as "models.paper.oorc".
        root: folder that holds the packages.
    """
    digest = hashlib.sha256()
    for module in imported_modules(modules, root):
        digest.update(module.encode())
        digest.update(_statements(_file(module, root)).encode())
        digest.update(file_digest(root / name for name in DATA.get(module, ())).encode())
    return digest.hexdigest()


@lru_cache(maxsize=64)
def outside_digest(module: str) -> str:
    """SHA-256 of a module that is not ours, with all of its package; empty for one of ours.

    Args:
        module: dotted name of a module that can be imported.
    """
    if _file(module, ROOT).is_file():
        return ""
    spec = None
    with suppress(ValueError):  # a module that was made on the spot has none
        spec = find_spec(module.partition(".")[0])
    folders = list(spec.submodule_search_locations or ()) if spec else []
    files = [file for folder in folders for file in sorted(Path(folder).rglob("*.py"))]
    return file_digest(files or [Path(spec.origin or "")] if spec else [])


def imported_modules(modules: Sequence[str], root: Path = ROOT) -> list[str]:
    """These modules and all modules below ``root`` that they import, wherever the import stands.

    >>> "link.ratex" in imported_modules(["models.paper.oorc"])
    True
    >>> "sender.player" in imported_modules(["models.paper.oorc"])
    False
    """
    found: dict[str, None] = {}
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module in found or not _file(module, root).is_file():
            continue
        found[module] = None
        waiting += _imports(module, root)
    return sorted(found)


def short_digest(*parts: str) -> str:
    """First 16 hexadecimal digits of the SHA-256 of some lines, to name a file of stored results.

    >>> short_digest("seed 0", "version 1")
    '2eb09a246924e199'
    """
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def package_versions() -> list[str]:
    """Name and version of each of `PACKAGES`."""
    return [f"{package} {version(package)}" for package in PACKAGES]


def _file(module: str, root: Path) -> Path:
    """Path that the file of a module has if the module is ours."""
    place = root / module.replace(".", "/")
    return place / "__init__.py" if place.is_dir() else place.with_suffix(".py")


def _imports(module: str, root: Path) -> Iterator[str]:
    """Names that may be modules of ours, from every import statement of a module."""
    for node in ast.walk(ast.parse(_file(module, root).read_text("utf-8"))):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            names = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        else:
            continue
        yield from names


def _statements(file: Path) -> str:
    """The module's syntax tree as text, without docstrings and positions."""
    tree = ast.parse(file.read_text("utf-8"))
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [part for part in body if not _is_text(part)]  # type: ignore[attr-defined]
    return ast.dump(tree)


def _is_text(node: ast.AST) -> bool:
    """Whether a statement is a string alone: a docstring, or the description of a constant."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
