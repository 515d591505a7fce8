"""Provenance of a result: command, versions, seed, commit and machine."""

import os
import platform
import subprocess
import sys
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from link.modules import ROOT

STATED_PACKAGES = (
    "torch", "kornia", "numpy", "opencv-python-headless", "scikit-learn", "onnxruntime",
)  # fmt: skip
"""Installed packages whose versions a stored result states."""


@dataclass(frozen=True)
class Making:
    """Keys that state how a stored result was made, beside the versions of packages."""

    seed: Annotated[int, Field(ge=0)]
    """Seed of all random draws."""
    simulated: bool
    """Whether the captures are simulated."""
    command: str
    """Command line that made the result."""


@dataclass(frozen=True)
class Machine:
    """The machine that made a result; it has no name here."""

    system: str
    """Operating system and architecture."""
    processor: str
    """Model of the processor."""
    cores: int
    """Number of cores."""


def command() -> str:
    """The command line, as one types it in the checkout; what is not UTF-8 is escaped."""
    spec = getattr(sys.modules["__main__"], "__spec__", None)
    name = f"-m {spec.name.removesuffix('.__main__')}" if spec else Path(sys.argv[0]).name
    return " ".join(["python", name, *sys.argv[1:]]).encode(errors="backslashreplace").decode()


def provenance(seed: int, simulated: bool) -> dict[str, Any]:
    """State how a result was made: whether it is simulated, seed, command, versions."""
    return {
        "simulated": simulated,
        "seed": seed,
        "command": command(),
        "python": platform.python_version(),
        **{package: version(package) for package in STATED_PACKAGES},
    }


def commit() -> str:
    """Commit of the checkout, with a word if tracked files differ from it; empty without git."""

    def git(*arguments: str) -> str:
        done = subprocess.run(
            ["git", *arguments], cwd=ROOT, capture_output=True, text=True, check=False
        )
        return done.stdout.strip() if done.returncode == 0 else ""

    try:
        head = git("rev-parse", "--short=12", "HEAD")
        changed = head and git("status", "--porcelain", "--untracked-files=no")
    except OSError:
        return ""
    return f"{head}, with changes" if changed else head


def machine() -> Machine:
    """Describe this machine, without the name of the host."""
    model = platform.processor() or platform.machine()
    cpuinfo = Path("/proc/cpuinfo")
    if cpuinfo.is_file():
        lines = cpuinfo.read_text(errors="replace").splitlines()
        model = next((line.split(":")[1].strip() for line in lines if "model name" in line), model)
    return Machine(f"{platform.system()} {platform.machine()}", model, os.cpu_count() or 1)
