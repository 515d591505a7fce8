"""The receiver in the browser beside Python's, on the same films: python -m reports.films.page.

Displays are filmed by a simulated hand-held camera of 30 frames a second. Python's receiver reads
the gray frames, and the page's receiver reads the same frames from a file, in Node.js. Both look
for all presets, on one thread. A film ends three loops of the message after its beginning, or some
time after Python has the message.

Films are read one after the other, so that times can be compared. Needs Node.js and npm.
"""

import base64
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.pairs import PAIRS
from export.receive.decoders import ShippedDecoder
from export.receive.receiver import Receiver
from export.web.site import build_site, run_node
from link.errors import at_least, choose, read_flags, run_cli
from link.images import as_gray, write_bytes
from models import shipped_graphs
from reports.engine.backends import one_thread
from reports.engine.provenance import provenance
from reports.films.delivery import DeliveryConfig, MessageFilm, Take, film_message
from reports.render.tables import Table, share_interval, write_blocks
from reports.score.accuracy import wilson

SETTINGS = {
    "paper": DeliveryConfig(n_bytes=100),
    "robust": DeliveryConfig(preset="robust", n_bytes=100),
    "hidden": DeliveryConfig(preset="hidden", kappa=1, n_bytes=100),
}
"""Settings of display, camera and message, by name of the preset; all show 15 states a second."""
VIEWS = (0.0, 45.0)
"""Angles between the camera and the normal of the display, degrees."""
LONGER, MORE_S = 2.0, 1.0
"""Factor by which a film goes on beyond the time at which Python has the message, and seconds that
it goes on longer."""


@dataclass(frozen=True)
class PageConfig:
    """The page's receiver beside Python's, on the same films (simulated)."""

    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of settings, keys of SETTINGS in reports/films/page.py."""
    films: int = 20
    """Number of films of each setting."""
    seed: int = 0
    """Seed of all draws."""
    out: Path = Path("runs/page")
    """Folder of page.json and of the site."""
    page: Path = Path("docs/phone.md")
    """Page whose block "page" is written."""


@dataclass(frozen=True)
class Read:
    """What one receiver made of one film."""

    data: bytes | None
    """The message, or None where none came."""
    time: float
    """Time of the film until then, seconds."""
    frames: int
    """Number of frames until then."""
    seconds: float
    """Time that the receiver took for them, seconds."""
    stages: dict[str, float]
    """Part of this time that each stage took, seconds."""
    memory: int | None = None
    """Memory of the process, in bytes, where it was measured."""


class Y4mFile:
    """A film of gray frames without compression, written frame by frame.

    Args:
        path: of the file.
        fps: frames a second.
    """

    def __init__(self, path: Path, fps: float) -> None:
        self._file = path.open("wb")
        self._rate = f"F{round(1000 * fps)}:1000"
        self._begun = False

    def __enter__(self) -> "Y4mFile":
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, gray: NDArray[np.uint8], time: float) -> None:
        """Append a frame, (H, W) uint8, and its time in seconds."""
        if not self._begun:
            height, width = gray.shape
            self._file.write(f"YUV4MPEG2 W{width} H{height} {self._rate} Ip Cmono\n".encode())
            self._begun = True
        self._file.write(f"FRAME XTIME={time:.6f}\n".encode())
        self._file.write(gray.tobytes())


def gray_frames(filmed: MessageFilm) -> Iterator[tuple[NDArray[np.uint8], float]]:
    """Give a film's frames as (H, W) uint8 and their times in seconds."""
    for frame in filmed.frames:
        yield as_gray(frame.rgb), frame.time_s


def read_in_python(filmed: MessageFilm, path: Path) -> Read:
    """Read a film by Python's receiver, and write it to a file for the page's."""
    fps = filmed.take.config.fps
    decoders = [ShippedDecoder(graph, layout, 1) for layout, graph in shipped_graphs().items()]
    receiver = Receiver(decoders, fps)
    read: Read | None = None
    frames, seconds, time = 0, 0.0, 0.0
    with Y4mFile(path, fps) as file:
        for gray, time in gray_frames(filmed):
            file.write(gray, time)
            if read is not None:
                if time > LONGER * read.time + MORE_S:
                    break
                continue
            start = perf_counter()
            step = receiver.push(gray, time)
            frames, seconds = frames + 1, seconds + perf_counter() - start
            if step.message is not None:
                data, stages = step.message.data, dict(receiver.timing.spent)
                read = Read(data, time, frames, seconds, stages)
    return read or Read(None, time, frames, seconds, dict(receiver.timing.spent))


def read_in_node(site: Path, path: Path) -> Read:
    """Read a film by the page's receiver in Node.js.

    Raises:
        InputError: it fails.
    """
    said = run_node(["node", "read.js", str(site.absolute()), str(path.absolute())])
    read: dict[str, Any] = json.loads(said)
    data = None if read["data"] is None else base64.b64decode(read["data"])
    return Read(data, read["time"], read["frames"], read["seconds"], read["stages"], read["memory"])


def read_film(name: str, number: int, config: PageConfig, site: Path) -> dict[str, Any]:
    """Read one film by both receivers.

    Returns:
        setting and number of the film, the message, and both `Read`, ``python`` and ``page``.
    """
    setting = replace(SETTINGS[name], seed=config.seed)
    views, pairs = len(VIEWS), list(PAIRS)
    view, pair = VIEWS[number % views], pairs[number // views % len(pairs)]
    filmed = film_message(Take(setting, pair, view, number, Path()))
    with TemporaryDirectory() as folder:
        path = Path(folder) / "film.y4m"
        python = read_in_python(filmed, path)
        page = read_in_node(site, path)
    film = {"setting": name, "number": number, "pair": pair, "view_deg": view}
    return {**film, "message": filmed.message, "python": python, "page": page}


def page_table(films: Sequence[dict[str, Any]]) -> Table:
    """Compare deliveries, times of the film, and frames a second of both receivers."""
    rows = []
    for name in dict.fromkeys(film["setting"] for film in films):
        mine = [film for film in films if film["setting"] == name]
        row = [name, str(len(mine))]
        for who in ("python", "page"):
            came = sum(film[who].data == film["message"] for film in mine)
            interval = share_interval(*wilson(came, len(mine)), 0)
            row.append(f"{came} ({interval} %)")
        row.append(str(sum(film["page"].data not in (None, film["message"]) for film in mine)))
        both = [film for film in mine if film["python"].data and film["page"].data]
        times = np.array([[film[who].time for who in ("python", "page")] for film in both])
        rates = np.array(
            [[film[who].frames / film[who].seconds for who in ("python", "page")] for film in mine]
        )
        if len(both):
            ratios = times[:, 1] / times[:, 0]
            row += [f"{value:.1f}" for value in np.median(times, axis=0)]
            row.append(f"{np.median(ratios):.2f} ({ratios.min():.2f} – {ratios.max():.2f})")
        else:
            row += ["–"] * 3
        row += [f"{value:.0f}" for value in np.median(rates, axis=0)]
        rows.append(row)
    heads = ["preset", "films", "Python", "page", "wrong, page", "Python, s", "page, s"]
    heads += ["page's s over Python's", "Python, frames/s", "page, frames/s"]
    title = (
        "Simulated hand-held films at 1280 × 720, 30 frames/s, of 15 states/s, with messages of "
        "100 bytes, at 0° and 45°; both receivers on one thread. Medians; 95 % intervals of shares."
    )
    return Table(heads, rows, title)


def stages_table(films: Sequence[dict[str, Any]]) -> Table:
    """Compare the time that each stage takes for a camera frame, in milliseconds."""
    rows = []
    for name in dict.fromkeys(film["setting"] for film in films):
        mine = [film for film in films if film["setting"] == name]
        for stage in mine[0]["python"].stages:
            spent = [
                np.median(
                    [1000 * film[who].stages.get(stage, 0) / film[who].frames for film in mine]
                )
                for who in ("python", "page")
            ]
            ratio = f"{spent[1] / spent[0]:.1f}" if spent[0] > 0 else "–"
            rows.append([name, stage, f"{spent[0]:.2f}", f"{spent[1]:.2f}", ratio])
    heads = ["preset", "stage", "Python, ms a frame", "page, ms a frame", "page over Python"]
    return Table(heads, rows, "Median over the films of the time that a stage took.", left=2)


def main() -> None:
    """Film, read twice, print, store page.json, and write the page's block."""
    config = read_flags(lambda: tyro.cli(PageConfig))
    at_least(1, films=config.films)
    at_least(0, seed=config.seed)
    for name in config.settings:
        choose(SETTINGS, name, "name in --settings")
    one_thread()
    site = config.out / "site"
    build_site(site)
    wanted = list(product(config.settings, range(config.films)))
    films = [read_film(name, number, config, site) for name, number in tqdm(wanted, "films")]
    tables = f"{page_table(films).markdown()}\n\n{stages_table(films).markdown()}"
    stored = [
        {
            **film,
            "message": film["message"].hex(),
            **{
                who: asdict(film[who]) | {"data": film[who].data and film[who].data.hex()}
                for who in ("python", "page")
            },
        }
        for film in films
    ]
    content = {"meta": provenance(config.seed, simulated=True), "films": stored}
    write_bytes(config.out / "page.json", (json.dumps(content, indent=1) + "\n").encode())
    print(tables)
    write_blocks(config.page, {"page": tables})


if __name__ == "__main__":
    run_cli(main)
