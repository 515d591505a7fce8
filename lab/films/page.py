"""The receiver in the browser beside Python's, on the same films.

Displays are filmed by a simulated hand-held camera of 30 frames a second. Both receivers look for
all presets that they read. Python's receiver reads the gray frames of each film. The page's
receiver reads the same film in one of two ways:

- ``--by node``: it reads the frames from a file, in Node.js, one after another; both receivers have
  one thread. The file waits for them.
- ``--by chromium``: the whole page runs in Chromium, before a simulated camera (camera.js) that
  plays the film in its own time. Frames that come while the page is busy are lost, as on a phone;
  so are those that come while Python's receiver is busy. The page is opened twice: a browser
  compiles its code at the first visit, and keeps it for the next.

The seconds until the message are those of the camera, from the first frame that a receiver which
is ready could take. Python's receiver is ready before the film begins. In Chromium, the page's
seconds begin when the camera has been opened and the page has said that it is ready, whichever
comes later; how long that takes from the page's opening is told beside them.

Films are read one after the other whatever ``--jobs`` says, so that times can be compared. Needs
Node.js and npm; ``chromium`` needs Playwright and Chromium, too.
"""

import base64
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter, sleep
from typing import TYPE_CHECKING, Any

import numpy as np

from data_gen.film.message import FilmSettings, MessageFilm, Take, film_message
from data_gen.pairs import PAIRS
from lab.films.browser import open_chromium, serve_folder, text_of
from lab.films.y4m import read_y4m, write_y4m
from lab.study import Results, Study, StudyFlags, Workshop
from link.code.framing import frames_needed
from link.errors import at_least, choose, each_once
from link.images import as_gray, replaced
from receiver.decoders import open_decoders
from receiver.receiver import Receiver
from reports.engine.backends import Backend, one_thread
from reports.engine.digest import code_digest, package_versions, short_digest
from reports.render.tables import Table, share_interval
from reports.score.intervals import wilson
from web.host.site import build_site, run_node

if TYPE_CHECKING:
    from playwright.sync_api import Page

SETTINGS = {
    "robust": FilmSettings(preset="robust", n_bytes=100),
    "hidden": FilmSettings(preset="hidden", kappa=1, state_hz=60, n_bytes=100),
}
"""Settings of display, camera and message, by name of the preset, whose states a second they
show."""
WAYS = {"node": "page", "chromium": "camera"}
"""Ways in which the page reads films, by the name that ``--by`` takes, and the blocks of
docs/phone.md that show them."""
RECEIVERS = ("python", "page")
"""Names of the two receivers."""
VIEWS = (0.0, 45.0)
"""Angles between the camera and the normal of the display, degrees."""
FILM_S = {"node": 6.3, "chromium": 36.0}
"""Length of a film, seconds, by the way in which the page reads it."""
CAMERA_S = 30.0
"""Time, in seconds, that the page has before the camera until a film is given up."""
STAYED_S = 6.0
"""Least time, in seconds, for which the first visit lasts, so that the browser keeps what it has
compiled."""
FILMED_BY = ("data_gen.film.stream", "data_gen.frame_pair")
"""Modules that decide, with all that they import, what a film shows."""
FILMED = (
    "Simulated hand-held films at 1280 × 720, 30 frames/s, of the presets at their own rates, with "
    "messages of 100 bytes, at 0° and 45°."
)
"""Words above a table of films."""
STATISTICS = "Medians; shares have 95 % intervals, ratios the least and the largest of the films."
"""Words about the numbers of a table of films."""
READ = {
    "node": f"Each is {FILM_S['node']:g} s long. Both receivers on one thread. {STATISTICS}",
    "chromium": (
        f"In Chromium a camera plays each in the film's own time, for at most {CAMERA_S:g} s. "
        "Seconds run from the first frame that a receiver could take, which is ready by then. "
        "Frames are those that it had time for; Python's receiver takes the film's in their own "
        f"time, too. The page had been opened before, but for the last column. {STATISTICS}"
    ),
}
"""Words above a table of how films were read, by the way of the page."""
TAKEN = re.compile(r"(\d+) frames read")
"""Pattern of the number of frames that the page shows among its details."""
CAMERA = Path(__file__).with_name("camera.js")
"""Script that gives the page a camera which plays a film."""
WATCH = """
window.seen = { camera: null, ready: null, message: null };
const devices = navigator.mediaDevices;
const open = devices.getUserMedia.bind(devices);
devices.getUserMedia = async (wanted) => {
  const stream = await open(wanted);
  window.seen.camera ??= performance.now();
  return stream;
};
addEventListener("DOMContentLoaded", () => {
  const [letter, record] = ["letter", "record"].map((id) => document.getElementById(id));
  const look = () => {
    if (!record.disabled) window.seen.ready ??= performance.now();
    if (!letter.hidden) window.seen.message ??= performance.now();
  };
  const looking = new MutationObserver(look);
  for (const each of [letter, record]) looking.observe(each, { attributes: true });
});
"""
"""Script that notes when the camera is open, when the page is ready to read, which allows it to
record, and when the message is shown, in milliseconds since the page was opened."""


@dataclass(frozen=True)
class PageFlags(StudyFlags):
    """The page's receiver beside Python's, on the same films (simulated)."""

    by: str = "node"
    """Way in which the page reads: "node" from files, "chromium" before a simulated camera."""
    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of settings, keys of SETTINGS in lab/films/page.py."""
    films: int = 20
    """Number of films of each setting."""
    kept: Path | None = None
    """Folder in which films are kept, 0.3 to 1.5 GB each, so that another run need not simulate
    them."""


@dataclass(frozen=True)
class Read:
    """What one receiver made of one film."""

    data: str | None
    """The message as hexadecimal digits, or None where none came."""
    time: float
    """Time of the camera until then, seconds, from the first frame that could be taken."""
    frames: int
    """Number of frames that the receiver took until then."""
    seconds: float
    """Time that the receiver took for them, seconds; before a camera the whole time."""
    stages: dict[str, float]
    """Part of this time that each stage took, seconds; empty where it was not measured."""
    waited: float = 0.0
    """Time from the page's opening until it could take a frame, seconds; 0 without a camera."""


@dataclass(frozen=True)
class FilmRead:
    """One film that both receivers read."""

    setting: str
    """Name of the setting."""
    pair: str
    """Camera-display pair."""
    view_deg: float
    """Angle between the camera and the normal of the display, degrees."""
    message: str
    """Message that the display sent, as hexadecimal digits."""
    python: Read
    """What Python's receiver made of the film."""
    page: Read
    """What the page's receiver made of it."""
    first: Read | None = None
    """What it made of it when the page was opened for the first time, before a camera."""

    def read_by(self, who: str) -> Read:
        """Return what one receiver made of it, "python" or "page"."""
        return self.python if who == "python" else self.page

    @classmethod
    def from_stored(cls, fields: dict[str, Any]) -> "FilmRead":
        """Make what `dataclasses.asdict` returned into an object again."""
        reads = {who: Read(**fields[who]) for who in (*RECEIVERS, "first") if fields.get(who)}
        return cls(**fields | reads)


@dataclass(frozen=True)
class PageContent:
    """What was measured."""

    films: list[dict[str, Any]]
    """Every film: the fields of a `FilmRead`."""


@dataclass(frozen=True)
class PageTake:
    """One film that is to be read in one way."""

    way: str
    """Way in which the page reads, a key of `WAYS`."""
    setting: str
    """Name of the setting."""
    number: int
    """Number of the film among those of its setting."""
    seed: int
    """Seed of all draws."""
    site: Path
    """Folder of the page's site."""
    kept: Path | None
    """Folder in which films are kept, or None."""

    def film(self) -> MessageFilm:
        """Draw the film; no frame is filmed yet."""
        settings = SETTINGS[self.setting]
        frames = frames_needed(settings.n_bytes, settings.layout.n_bits, "n_bytes")
        settings = replace(settings, loops=FILM_S[self.way] * settings.state_hz / (2 * frames))
        views, pairs_filmed = len(VIEWS), list(PAIRS)
        view = VIEWS[self.number % views]
        pair = pairs_filmed[self.number // views % len(pairs_filmed)]
        return film_message(Take(settings, pair, view, self.number, self.seed))


def film_mark(take: PageTake) -> str:
    """Name all that decides the films of a setting and a way, apart from their numbers."""
    drawn = repr((SETTINGS[take.setting], take.seed, FILM_S[take.way]))
    return short_digest(drawn, code_digest(*FILMED_BY), *package_versions())


@contextmanager
def film_file(take: PageTake, filmed: MessageFilm) -> Iterator[Path]:
    """Write a film to a file, or take it from where it is kept; one that is not is removed."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "film.y4m"
        if take.kept is not None:
            path = take.kept / f"{take.setting}_{take.number}_{film_mark(take)}.y4m"
        if not path.is_file():
            with replaced(path) as hidden, hidden.open("wb") as stream:
                grays = (as_gray(frame.rgb) for frame in filmed.frames)
                write_y4m(stream, grays, filmed.take.settings.fps)
        yield path


def read_in_python(filmed: MessageFilm, path: Path, waits: bool) -> Read:
    """Read a film's file by Python's receiver.

    Args:
        filmed: the film.
        path: its file.
        waits: whether the film waits for the receiver, as a camera does not.
    """
    decoders, film = open_decoders(None, 1)
    fps = filmed.take.settings.fps
    receiver = Receiver(decoders, fps, film=film)
    message: str | None = None
    seconds, time, begun = 0.0, 0.0, perf_counter()
    for number, gray in enumerate(read_y4m(path)):
        time = number / fps
        early = begun + time - perf_counter()
        if not waits and early < -1 / fps:
            continue
        sleep(0 if waits else max(0, early))
        start = perf_counter()
        step = receiver.push(gray, time)
        seconds += perf_counter() - start
        if step.message is not None:
            message = step.message.data.hex()
            break
    time = time if waits else perf_counter() - begun
    return Read(message, time, receiver.frames, seconds, dict(receiver.timing.spent))


def read_in_node(site: Path, path: Path) -> Read:
    """Read a film by the page's receiver in Node.js.

    Raises:
        InputError: it fails.
    """
    said = run_node(["node", "read.js", str(site.absolute()), str(path.absolute())])
    read: dict[str, Any] = json.loads(said)
    data = None if read["data"] is None else base64.b64decode(read["data"]).hex()
    return Read(data, read["time"], read["frames"], read["seconds"], read["stages"])


def read_in_chromium(site: Path, path: Path) -> tuple[Read, Read]:
    """Let the page watch a film by a simulated camera, at its first visit and at the next.

    Raises:
        InputError: Playwright or Chromium is missing.
    """
    others = {"film.y4m": path, CAMERA.name: CAMERA}
    with serve_folder(site, others) as address, open_chromium() as page:
        for script in (CAMERA.read_text(encoding="utf-8"), WATCH):
            page.add_init_script(script)
        begun = perf_counter()
        first = visit(page, address)
        page.wait_for_timeout(max(0.0, 1000 * (begun + STAYED_S - perf_counter())))
        page.goto("about:blank")
        return first, visit(page, address)


def visit(page: "Page", address: str) -> Read:
    """Open the page, and wait until it has a message or none in time."""
    page.goto(address)
    end = perf_counter() + CAMERA_S
    while (seen := page.evaluate("seen"))["message"] is None and perf_counter() < end:
        page.wait_for_timeout(100)
    taken = TAKEN.search(text_of(page, "details"))
    data, time = None, CAMERA_S
    waited = max(seen["camera"] or 0, seen["ready"] or 0) / 1000
    if seen["message"] is not None:
        time = seen["message"] / 1000 - waited
        with page.expect_download() as saved:
            page.locator("#keep").click()
        data = Path(saved.value.path()).read_bytes().hex()
    return Read(data, time, int(taken[1]) if taken else 0, time, {}, waited)


def read_film(take: PageTake) -> dict[str, Any]:
    """Film, and read the film by both receivers.

    Returns:
        the fields of a `FilmRead`, as JSON holds them.
    """
    one_thread()
    filmed = take.film()
    with film_file(take, filmed) as path:
        python = read_in_python(filmed, path, waits=take.way == "node")
        if take.way == "node":
            first, page = None, read_in_node(take.site, path)
        else:
            first, page = read_in_chromium(take.site, path)
    of = filmed.take
    message = filmed.message.hex()
    return asdict(FilmRead(take.setting, of.pair, of.view, message, python, page, first))


def read_films(flags: PageFlags, workshop: Workshop, site: Path) -> list[FilmRead]:
    """Read all films, one after the other; the site must be built."""
    takes = {
        f"{flags.by} {name} {number}": PageTake(
            flags.by, name, number, flags.seed, site, flags.kept
        )
        for name, number in product(flags.settings, range(flags.films))
    }
    files = [site / name for name in ("worker.js", "decoding.js", "presets.json")]
    files += [site / "page.js", CAMERA] if flags.by == "chromium" else []
    files += [*sorted(site.rglob("*.onnx")), *sorted(site.glob("*.wasm"))]
    stored = replace(workshop, backend=Backend()).each(read_film, takes, files)
    return [FilmRead.from_stored(fields) for fields in stored.values()]


def page_table(films: Sequence[FilmRead], by: str) -> Table:
    """Compare deliveries, times of the message, and frames a second of both receivers.

    Args:
        films: films that both receivers read.
        by: way in which the page read them, a key of `WAYS`.
    """
    rows = []
    for name in dict.fromkeys(film.setting for film in films):
        mine = [film for film in films if film.setting == name]
        row = [name, str(len(mine))]
        for who in RECEIVERS:
            came = sum(film.read_by(who).data == film.message for film in mine)
            interval = share_interval(*wilson(came, len(mine)), 0)
            row.append(f"{came} ({interval} %)")
        row.append(str(sum(film.page.data not in (None, film.message) for film in mine)))
        both = [film for film in mine if film.python.data and film.page.data]
        times = np.array([[film.python.time, film.page.time] for film in both])
        if len(both):
            ratios = times[:, 1] / times[:, 0]
            row += [f"{value:.1f}" for value in np.median(times, axis=0)]
            row.append(f"{np.median(ratios):.2f} ({ratios.min():.2f} – {ratios.max():.2f})")
        else:
            row += ["–"] * 3
        for who in RECEIVERS:
            rates = [film.read_by(who).frames / film.read_by(who).seconds for film in mine]
            row.append(f"{np.median(rates):.0f}")
        if by == "chromium":
            row.append(f"{np.median([film.page.waited for film in mine]):.1f}")
            firsts = [film.first.time for film in mine if film.first]
            row.append(f"{np.median(firsts):.1f}")
        rows.append(row)
    heads = ["preset", "films", "Python", "page", "wrong, page", "Python, s", "page, s"]
    heads += ["page's s over Python's", "Python, frames/s", "page, frames/s"]
    if by == "chromium":
        heads += ["page opened until ready, s", "page at first visit, s"]
    return Table(heads, rows, f"{FILMED} {READ[by]}")


def stages_table(films: Sequence[FilmRead]) -> Table:
    """Compare the time that each stage takes for a camera frame, in milliseconds."""
    rows = []
    for name in dict.fromkeys(film.setting for film in films):
        mine = [film for film in films if film.setting == name]
        for stage in mine[0].python.stages:
            spent = []
            for who in RECEIVERS:
                reads = [film.read_by(who) for film in mine]
                times = [1000 * read.stages.get(stage, 0) / read.frames for read in reads]
                spent.append(np.median(times))
            ratio = f"{spent[1] / spent[0]:.1f}" if spent[0] > 0 else "–"
            rows.append([name, stage, f"{spent[0]:.2f}", f"{spent[1]:.2f}", ratio])
    heads = ["preset", "stage", "Python, ms a frame", "page, ms a frame", "page over Python"]
    return Table(heads, rows, "Median over the films of the time that a stage took.", left=2)


def check_page(flags: PageFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, films=flags.films)
    each_once(settings=flags.settings)
    choose(WAYS, flags.by, "way in --by")
    for name in flags.settings:
        choose(SETTINGS, name, "name in --settings")


def measure_page(flags: PageFlags, workshop: Workshop) -> PageContent:
    """Build the site, film, and read every film by both receivers."""
    site = workshop.out / "site"
    build_site(site)
    return PageContent([asdict(film) for film in read_films(flags, workshop, site)])


def page_blocks(results: Mapping[str, Results[PageContent]]) -> dict[str, str]:
    """Show how films were read, by each way of the page that was measured."""
    blocks = {}
    for by, block in WAYS.items():
        if block in results:
            films = [FilmRead.from_stored(fields) for fields in results[block].content.films]
            tables = [page_table(films, by), *([stages_table(films)] if by == "node" else [])]
            blocks[block] = "\n\n".join(table.markdown() for table in tables)
    return blocks


STUDY = Study(
    name="page",
    flags=PageFlags,
    content=PageContent,
    measure=measure_page,
    blocks=page_blocks,
    page=Path("docs/phone.md"),
    check=check_page,
    label=lambda flags: WAYS[flags.by],
)
"""The study that `python -m lab page` runs."""
