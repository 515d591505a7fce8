"""Digests of what decides a result: the code that it really runs, files, and installed packages.

Stored results are named after such a digest, so that a run goes on where it was cut off, and starts
anew where something changed that matters. Comments, docstrings and modules that are not imported do
not matter.
"""

import ast
import hashlib
from collections.abc import Iterable
from contextlib import suppress
from functools import lru_cache
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path

from link.modules import ROOT, imported_modules, module_file

PACKAGES = ("numpy", "scipy", "opencv-python-headless", "scikit-image", "scikit-learn", "torch")
"""Installed packages that decide what a decoder answers, up to the processor's rounding."""
DATA = {
    "data_gen.effects": ("data_gen/effects.json",),
    "data_gen.pairs": ("data_gen/paper.json", "data_gen/today.json"),
    "data_gen.pictures.drawings": ("data_gen/pictures/texts.json",),
    "data_gen.pictures.library": ("data_gen/pictures/built_in.json",),
}
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
        digest.update(_statements(module_file(module, root)).encode())
        digest.update(file_digest(root / name for name in DATA.get(module, ())).encode())
    return digest.hexdigest()


@lru_cache(maxsize=64)
def outside_digest(module: str) -> str:
    """SHA-256 of a module that is not ours, with all of its package; empty for one of ours.

    Args:
        module: dotted name of a module that can be imported.
    """
    if module_file(module).is_file():
        return ""
    spec = None
    with suppress(ValueError):  # a module that was made on the spot has none
        spec = find_spec(module.partition(".")[0])
    folders = list(spec.submodule_search_locations or ()) if spec else []
    files = [file for folder in folders for file in sorted(Path(folder).rglob("*.py"))]
    return file_digest(files or [Path(spec.origin or "")] if spec else [])


def short_digest(*parts: str) -> str:
    """First 16 hexadecimal digits of the SHA-256 of some lines, to name a file of stored results.

    >>> short_digest("seed 0", "version 1")
    '2eb09a246924e199'
    """
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def package_versions() -> list[str]:
    """Name and version of each of `PACKAGES`."""
    return [f"{package} {version(package)}" for package in PACKAGES]


def _statements(file: Path) -> str:
    """The module's syntax tree as text, without docstrings and positions."""
    return ast.dump(_WithoutTexts().visit(ast.parse(file.read_text("utf-8"))))


class _WithoutTexts(ast.NodeTransformer):
    """Leaves out strings that stand alone: docstrings, and descriptions of constants."""

    def visit_Expr(self, node: ast.Expr) -> ast.Expr | None:
        return None if isinstance(getattr(node.value, "value", None), str) else node
