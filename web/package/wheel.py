"""Pack the receiving side as a Python wheel, with one import name of its own.

The module `api` becomes the package `oorc_receiver`, and all that it imports from the checkout lies
below `oorc_receiver._checkout`, with its imports rewritten. hatchling makes the wheel of this tree.
"""

import ast
import json
import tomllib
from pathlib import Path
from tempfile import TemporaryDirectory

from hatchling.builders.wheel import WheelBuilder

from link import __version__
from link.images import write_bytes
from link.modules import ROOT, imported_modules, module_file
from models import FILM_GRAPH, REGION_GRAPH, shipped_graphs
from web.package.schema import events_schema

NAME = "oorc_receiver"
"""Import name of the package."""
API = "web.package.api"
"""Module that becomes the package."""
OWN = ("link", "models", "data_gen", "export", "receiver", "sender", "web", "reports", "lab")
"""Names of the checkout's packages, none of which a wheel may install."""
PROJECT = Path(__file__).with_name("pyproject.template")
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
    project = PROJECT.read_text("utf-8").format(
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
        f"{NAME}/__init__.py": rewritten(module_file(API)),
        f"{NAME}/py.typed": b"",
        f"{NAME}/events.schema.json": json.dumps(events_schema(), indent=1).encode(),
        f"{inside}/__init__.py": b"",
    }
    imported = [module.split(".") for module in imported_modules([API]) if module != API]
    modules = {".".join(words[:end]) for words in imported for end in range(1, len(words) + 1)}
    for module in sorted(modules):
        file = module_file(module)
        files[f"{inside}/{file.relative_to(ROOT).as_posix()}"] = rewritten(file)
    for graph in (*shipped_graphs().values(), FILM_GRAPH, REGION_GRAPH):
        files[f"{inside}/{graph.relative_to(ROOT).as_posix()}"] = graph.read_bytes()
    return files


def rewritten(file: Path) -> bytes:
    """Read a module and put what it imports from the checkout below the package's name."""
    text = file.read_text("utf-8")
    lines = text.splitlines(keepends=True)
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.ImportFrom) and (node.module or "").partition(".")[0] in OWN:
            line, own = lines[node.lineno - 1], f"from {node.module}"
            lines[node.lineno - 1] = line.replace(own, f"from {NAME}._checkout.{node.module}", 1)
    return "".join(lines).encode()
