"""Pack the receiving side as a Python wheel, with one import name of its own.

The module `api` becomes the package `oorc_receiver`, and all that it imports from the checkout lies
below `oorc_receiver._checkout`, with its imports rewritten. hatchling makes the wheel of this tree.
"""

import ast
import json
import tomllib
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from hatchling.builders.wheel import WheelBuilder

from link import __version__
from link.images import write_bytes
from models import FILM_GRAPH, shipped_graphs
from web.package.schema import events_schema

ROOT = Path(__file__).parents[2]
"""Folder of the checkout."""
NAME = "oorc_receiver"
"""Import name of the package."""
API = "web.package.api"
"""Module that becomes the package."""
OWN = ("link", "models", "data_gen", "export", "receiver", "sender", "web", "reports", "lab")
"""Names of the checkout's packages, none of which a wheel may install."""
PROJECT = """\
[project]
name = "oorc-receiver"
version = "{version}"
description = "Read messages that a display hides in its picture, from camera frames"
readme = "README.md"
license = "Apache-2.0"
license-files = ["LICENSE"]
requires-python = "{python}"
dependencies = {requires}

[project.optional-dependencies]
opencv = {opencv}

[tool.hatch.build.targets.wheel]
packages = ["oorc_receiver"]
"""
"""The package's pyproject.toml, with names in place of what the checkout's own says. OpenCV is an
extra, because one of its packages installed over another breaks it for the application."""


def write_wheel(folder: Path) -> Path:
    """Write the wheel into a folder, which is made where it is missing.

    The same checkout gives the same bytes, because hatchling builds reproducibly.

    Raises:
        InputError: the folder cannot be written.
    """
    checkout = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    needed: list[str] = checkout["dependency-groups"]["receive"]
    opencv = [each for each in needed if each.startswith("opencv")]
    project = PROJECT.format(
        version=__version__,
        python=checkout["project"]["requires-python"],
        requires=json.dumps([each for each in needed if each not in opencv]),
        opencv=json.dumps(opencv),
    )
    files = package_files() | {
        "pyproject.toml": project.encode(),
        "README.md": (ROOT / "docs" / "embed.md").read_bytes(),
        "LICENSE": (ROOT / "LICENSE").read_bytes(),
    }
    with TemporaryDirectory() as tree:
        for path, data in files.items():
            write_bytes(Path(tree, path), data)
        (built,) = map(Path, WheelBuilder(tree).build(directory=f"{tree}/dist"))
        wheel = folder / built.name
        write_bytes(wheel, built.read_bytes())
    return wheel


def package_files() -> dict[str, bytes]:
    """Collect the files of the package, by their paths in site-packages."""
    inside = f"{NAME}/_checkout"
    files = {
        f"{NAME}/__init__.py": rewritten(_file_of(API)),
        f"{NAME}/py.typed": b"",
        f"{NAME}/events.schema.json": json.dumps(events_schema(), indent=1).encode(),
        f"{inside}/__init__.py": b"",
    }
    for module in sorted(needed_modules(API) - {API}):
        file = _file_of(module)
        files[f"{inside}/{file.relative_to(ROOT).as_posix()}"] = rewritten(file)
    for graph in (*shipped_graphs().values(), FILM_GRAPH):
        files[f"{inside}/{graph.relative_to(ROOT).as_posix()}"] = graph.read_bytes()
    return files


def needed_modules(module: str) -> set[str]:
    """Find the modules of the checkout that a module imports, itself and theirs included."""
    found: set[str] = set()
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name in found:
            continue
        found.add(name)
        for node in imports(ast.parse(_file_of(name).read_text("utf-8"))):
            modules = [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
            parts = [name.split(".") for name in modules if name and _file_of(name).is_file()]
            waiting += [
                ".".join(words[:end]) for words in parts for end in range(1, len(words) + 1)
            ]
    return found


def imports(tree: ast.Module) -> Iterator[ast.ImportFrom]:
    """Find each ``from … import`` of a module of the checkout, wherever it stands."""
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in OWN:
            yield node


def rewritten(file: Path) -> bytes:
    """Read a module and put what it imports from the checkout below the package's name."""
    text = file.read_text("utf-8")
    lines = text.splitlines(keepends=True)
    for node in imports(ast.parse(text)):
        line = lines[node.lineno - 1]
        own = f"from {node.module}"
        lines[node.lineno - 1] = line.replace(own, f"from {NAME}._checkout.{node.module}", 1)
    return "".join(lines).encode()


def _file_of(module: str) -> Path:
    """The file of a module of the checkout; one that does not exist where there is no such."""
    path = ROOT / module.replace(".", "/")
    return path / "__init__.py" if path.is_dir() else path.with_suffix(".py")
