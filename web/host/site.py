"""Build the site that sends and reads, a folder that any static host can serve over https.

JavaScript is bundled by esbuild, a tool of Node.js, from `web/page` and `web/port`. Everything else
that the pages need, such as the decoders' graphs and tables of the presets, comes from Python.
"""

import gzip
import json
import os
import re
import shutil
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from link.errors import InputError, ParameterError
from link.files.lock import locked
from link.files.together import lent_folder
from link.images import write_bytes, write_image
from link.presets import PRESETS
from models import FILM_GRAPH, REGION_GRAPH
from models.film.window import reads_films
from sender.compact import TEMPLATE
from web.host.constants import write_constants
from web.host.demo import write_demo
from web.host.tables import layout_table, send_preset
from web.host.warm import SIZE_PX, draw_warm_film

WEB = Path(__file__).parents[1]
"""Folder of the page's sources."""
MARK = "presets.json"
"""Name of a file that every site has; a folder without it is no site, and is not replaced."""
MAX_GZIP_BYTES = 5_000_000
"""Largest size of all files together, in bytes after gzip, that a phone should have to load."""
WARM_PRESET = "hidden"
"""Name of the preset whose film the page reads to get ready."""
ICON_SIDES = (192, 512)
"""Widths, in pixels, of the icons that phones show for the installed page."""
COMPLAINT = re.compile(r"Error: |\[ERROR\] |npm error [^c]")
"""Pattern of the lines in which Node.js, esbuild and npm say what is wrong."""
BUILD_S = 600
"""Time, in seconds, after which a command of Node.js is given up."""


@dataclass(frozen=True)
class Site:
    """Summary of a built site."""

    sizes: dict[str, int]
    """Size of each file in bytes, by its path in the folder."""
    gzip_bytes: int
    """Size of all files together in bytes, each after gzip, as hosts send them."""


def build_site(out: Path) -> Site:
    """Build the page in a folder, in place of an older one that may be there.

    Args:
        out: the folder, or a symbolic link to it; it is written under a temporary name and renamed
            when it is whole.

    Raises:
        InputError: Node.js is missing or fails, the folder holds something else, cannot be
            written, or another process writes it.
    """
    place = Path(os.path.realpath(out))
    with locked(place.parent, place.name):
        there = {path.name for path in place.iterdir()} if place.is_dir() else set()
        if (place.exists() and not place.is_dir()) or (there and MARK not in there):
            raise ParameterError("out", f"{out} is or holds something else; name a new folder")
        install_packages()
        write_constants()
        with lent_folder(place, out) as temporary:
            write_inputs(temporary)
            run_node(["node", "host/build.mjs", str(temporary)])
            site = measure_site(temporary)
            if site.gzip_bytes > MAX_GZIP_BYTES:
                raise InputError(
                    f"the site has {site.gzip_bytes} bytes after gzip, and a phone should load at "
                    f"most {MAX_GZIP_BYTES}; make its graphs or packages smaller"
                )
            if lost := there - {path.name for path in temporary.iterdir()}:
                said = f"{out} has {min(lost)}, which is not of a site; move it"
                raise ParameterError("out", said)
            old = temporary.with_suffix(".old")
            if place.is_dir():
                place.replace(old)
            temporary.replace(place)
            shutil.rmtree(old, ignore_errors=True)
    return site


def install_packages() -> None:
    """Install the packages that the lock file names, where they are not there as it names them.

    Raises:
        InputError: npm is missing or fails.
    """
    installed = WEB / "node_modules" / ".package-lock.json"
    there = locked_versions(installed) if installed.is_file() else {}
    if not locked_versions(WEB / "package-lock.json").items() <= there.items():
        run_node(["npm", "ci", "--no-fund", "--no-audit"])


def locked_versions(lock: Path) -> dict[str, str]:
    """Versions of the packages that a lock file of npm names, but for those of some systems."""
    packages = json.loads(lock.read_text("utf-8"))["packages"]
    return {
        name: package["version"]
        for name, package in packages.items()
        if name and not package.get("optional")
    }


def run_node(command: Sequence[str]) -> str:
    """Run a command of Node.js in the folder of the page's sources.

    Returns:
        what it prints.

    Raises:
        InputError: the program is missing, fails, or takes too long.
    """
    program = shutil.which(command[0])
    if program is None:
        raise InputError(
            f"{command[0]}: not found; install Node.js 20 or newer (https://nodejs.org)"
        )
    shown = " ".join(command)
    try:
        done = subprocess.run(
            [program, *command[1:]], cwd=WEB, capture_output=True, text=True, timeout=BUILD_S
        )
    except subprocess.TimeoutExpired:
        raise InputError(f"{shown}: gave no answer in {BUILD_S} s") from None
    if done.returncode != 0:
        said = [line.strip() for line in (done.stderr or done.stdout).splitlines() if line.strip()]
        named = [line for line in said if COMPLAINT.search(line)]
        why = [*named, *said[-1:], "it gives no reason"][0]
        raise InputError(f"{shown} failed in {WEB}: {why}")
    return done.stdout


def write_inputs(folder: Path) -> None:
    """Write what Python gives the pages: graphs, tables, the player, films, pictures and icons."""
    write_presets(folder)
    write_bytes(folder / TEMPLATE.name, TEMPLATE.read_bytes())
    write_demo(folder)
    film = draw_warm_film(PRESETS[WARM_PRESET].layout)
    write_bytes(folder / "warm/states.bin", film.states.tobytes())
    warm = {"layout": layout_table(film.layout), "width": SIZE_PX[0], "height": SIZE_PX[1]}
    write_bytes(folder / "warm.json", json.dumps(warm, separators=(",", ":")).encode())
    for side in ICON_SIDES:
        write_image(folder / f"icon-{side}.png", draw_icon(side))


def write_presets(folder: Path) -> None:
    """Write the graphs, layouts that the film decoder reads, and all presets as they are sent."""
    tables = [
        {"name": name, "layout": layout_table(preset.layout)}
        for name, preset in PRESETS.items()
        if reads_films(preset.layout)
    ]
    for graph in (FILM_GRAPH, REGION_GRAPH):
        write_bytes(folder / "models" / graph.name, graph.read_bytes())
    write_bytes(folder / MARK, json.dumps(tables, separators=(",", ":")).encode())
    sent = [send_preset(name, preset) for name, preset in PRESETS.items()]
    write_bytes(folder / "send.json", json.dumps(sent).encode())


def draw_icon(side: int) -> NDArray[np.uint8]:
    """Draw the icon as icon.svg has it, (side, side, 3) uint8, encoded RGB."""
    blocks = np.array([[1, 0, 1, 1], [0, 1, 0, 1], [1, 1, 0, 0], [0, 1, 1, 0]], bool)
    colours = np.where(blocks[:, :, None], np.array([94, 214, 166]), np.array([30, 74, 66]))
    icon = np.full((16, 16, 3), (16, 33, 31), np.uint8)
    icon[4:12, 4:12] = np.kron(colours, np.ones((2, 2, 1))).astype(np.uint8)
    return np.asarray(cv2.resize(icon, (side, side), interpolation=cv2.INTER_NEAREST), np.uint8)


def measure_site(folder: Path) -> Site:
    """Measure the files of a site."""
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    packed = sum(len(gzip.compress(path.read_bytes(), 9)) for path in files)
    return Site({p.relative_to(folder).as_posix(): p.stat().st_size for p in files}, packed)
