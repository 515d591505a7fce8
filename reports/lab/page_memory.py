"""Memory of the page while it watches for minutes: python -m reports.lab.page_memory.

The page runs in Chromium, whose simulated camera plays a film over and over: a room without a
display, and then a display whose message the page reads again each time that it has read it. Every
few seconds the memory of the process that runs the page is taken from the system, and the memory
that OpenCV and onnxruntime have from WebAssembly, which never gives any back.

Needs Linux, Node.js, Playwright and Chromium.
"""

import re
import shutil
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter
from typing import TYPE_CHECKING

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from data_gen.frame_pair import Source, shuffled_pictures
from export.web.site import build_site
from link.cli import read_flags, run_cli
from link.errors import ParameterError, at_least
from link.files.lock import locked
from link.images import as_gray
from link.presets import PRESETS
from reports.engine.checked import write_json
from reports.engine.provenance import provenance
from reports.films.browser import camera_flags, open_chromium, serve_folder, text_of
from reports.films.page import COUNTS, PageTake, film_file
from reports.films.y4m import Y4mFile
from reports.render.tables import Table, write_blocks

if TYPE_CHECKING:
    from playwright.sync_api import Page

SIZE = (1280, 720)
"""Width and height of the room's film, pixels."""
ROOM_FRAMES = 90
"""Number of frames of the room's film."""
DRIFT_PX, NOISE = 6.0, 2.0
"""Distance that the camera moves before the room, pixels, and noise of its frames, gray levels."""
EVERY_S = 5.0
"""Time from one measurement to the next, seconds."""
MAX_MINUTES = 24 * 60.0
"""Longest time for which a film is watched, minutes."""
MIB = 2**20
"""Number of bytes in a mebibyte."""
KEEP_MEMORIES = """
const memories = new Set();
for (const name of ["instantiate", "instantiateStreaming"]) {
  const usual = WebAssembly[name];
  WebAssembly[name] = async (source, imports) => {
    const made = await usual.call(WebAssembly, source, imports);
    const { exports } = made.instance ?? made;
    const own = [...Object.values(exports), ...Object.values(imports ?? {}).flatMap(Object.values)];
    for (const part of own) if (part instanceof WebAssembly.Memory) memories.add(part);
    return made;
  };
}
const channel = new BroadcastChannel("memory");
setInterval(() => {
  const bytes = [...memories].reduce((sum, { buffer }) => sum + buffer.byteLength, 0);
  channel.postMessage({ worker: self.location.pathname, bytes });
}, 500);
"""
"""Script that stands before a worker's own, and lets it say how much memory WebAssembly has."""
HEAR_MEMORIES = """
window.wasmBytes = 0;
const said = {};
new BroadcastChannel("memory").onmessage = ({ data }) => {
  said[data.worker] = data.bytes;
  window.wasmBytes = Object.values(said).reduce((sum, bytes) => sum + bytes, 0);
};
"""
"""Script of the page that notes what its workers say, so that nobody waits for a busy worker."""
WORKERS = ("worker.js", "decoding.js")
"""Files of the site that run in workers: the first reads frames, the second runs graphs."""


@dataclass(frozen=True)
class MemoryConfig:
    """Memory of the page before a camera (simulated)."""

    minutes: float = 10.0
    """Time for which each film is watched, minutes."""
    seed: int = 0
    """Seed of all draws."""
    kept: Path | None = None
    """Folder in which the film of the display is kept; by default it is filmed anew."""
    out: Path = Path("runs/page_memory")
    """Folder of the site and of memory.json."""
    page: Path = Path("docs/phone.md")
    """Page whose block "memory" is written."""


@dataclass(frozen=True)
class MemorySample:
    """Memory of the page at one time."""

    seconds: float
    """Time since the page was opened, seconds."""
    process_mib: float
    """Memory of the process that runs page and worker, which the system holds in RAM, MiB."""
    wasm_mib: float
    """Memory of OpenCV and onnxruntime in WebAssembly, a part of it, MiB."""
    frames: int
    """Number of frames that were read since the camera was started last."""
    messages: int
    """Number of messages that were read so far."""


def write_room(path: Path, seed: int, size: tuple[int, int] = SIZE) -> None:
    """Write a film, ``size`` (width, height), of a room: a picture, a slow drift, and noise."""
    source = Source(PRESETS["paper"].layout, "test", seed)
    gray = as_gray(shuffled_pictures(source)[0].rgb)
    margin = round(2 * DRIFT_PX)
    width, height = size
    wide = cv2.resize(gray, (width + margin, height + margin), interpolation=cv2.INTER_CUBIC)
    rng = np.random.default_rng(seed)
    with path.open("wb") as stream:
        film = Y4mFile(stream, 30, "420jpeg")
        for number in range(ROOM_FRAMES):
            turn = 2 * np.pi * number / ROOM_FRAMES  # the film's end meets its beginning
            x, y = DRIFT_PX * (1 + np.cos(turn)) / 2, DRIFT_PX * (1 + np.sin(turn)) / 2
            centre = (x + (width - 1) / 2, y + (height - 1) / 2)
            seen: NDArray[np.uint8] = np.asarray(cv2.getRectSubPix(wide, size, centre), np.uint8)
            noisy = seen + rng.normal(0, NOISE, seen.shape)
            film.write(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))


def watch_memory(
    site: Path, film: Path, seconds: float, every_s: float = EVERY_S
) -> Iterator[MemorySample]:
    """Let the page watch a film in Chromium's camera, and measure its memory meanwhile.

    A message that arrives is read again at once.

    Args:
        site: folder of the page's site.
        film: a .y4m file that Chromium plays.
        seconds: time after which it ends.
        every_s: time from one measurement to the next, seconds.

    Raises:
        InputError: Playwright or Chromium is missing.
    """
    with (
        TemporaryDirectory() as folder,
        serve_folder(measured_site(site, Path(folder))) as address,
        open_chromium(camera_flags(film)) as page,
    ):
        page.add_init_script(HEAR_MEMORIES)
        start, messages = perf_counter(), 0
        page.goto(address)
        while (now := perf_counter() - start) < seconds:
            page.wait_for_timeout(1000 * min(every_s, max(seconds - now, 0.1)))
            counts = COUNTS.search(text_of(page, "details"))
            if text_of(page, "message"):
                messages += 1
                page.locator("#again").click()
            yield MemorySample(
                seconds=round(perf_counter() - start, 1),
                process_mib=renderer_bytes(page) / MIB,
                wasm_mib=page.evaluate("wasmBytes") / MIB,
                frames=int(counts[1]) if counts else 0,
                messages=messages,
            )


def measured_site(site: Path, folder: Path) -> Path:
    """Copy a site to a folder, with workers that say how much memory WebAssembly has."""
    copy = folder / "site"
    shutil.copytree(site, copy)
    for name in WORKERS:
        (copy / name).write_text(KEEP_MEMORIES + (site / name).read_text())
    return copy


def renderer_bytes(page: "Page") -> int:
    """Memory, in bytes of RAM, of the process that runs a page, as Linux reports it."""
    browser = page.context.browser
    if browser is None:
        return 0
    session = browser.new_browser_cdp_session()
    processes = session.send("SystemInfo.getProcessInfo")["processInfo"]
    session.detach()
    sizes = [0]
    for process in processes:
        status = Path(f"/proc/{process['id']}/status")
        if process["type"] == "renderer" and status.is_file():
            found = re.search(r"VmRSS:\s+(\d+) kB", status.read_text())
            sizes.append(1024 * int(found[1]) if found else 0)
    return max(sizes)


def memory_table(watched: dict[str, list[MemorySample]]) -> Table:
    """Compare what a page needs after a tenth of the time, at most in both halves, and at the end.

    Args:
        watched: samples in the order of their times, by what was before the camera.
    """
    rows = []
    for name, samples in watched.items():
        early, last = samples[len(samples) // 10], samples[-1]
        process = [sample.process_mib for sample in samples]
        half = len(samples) // 2
        rows.append(
            [
                name,
                f"{last.seconds / 60:.1f}",
                str(last.messages),
                f"{early.process_mib:.0f}",
                f"{max(process[: half + 1]):.0f}",
                f"{max(process[half:]):.0f}",
                f"{last.process_mib:.0f}",
                f"{early.wasm_mib:.0f}",
                f"{last.wasm_mib:.0f}",
            ]
        )
    heads = ["before the camera", "minutes", "messages", "after a tenth, MiB"]
    heads += ["most, first half", "most, second half", "at the end"]
    heads += ["WebAssembly after a tenth", "at the end"]
    title = (
        "Memory of Chromium's process that runs the page, before its simulated camera of 1280 × "
        f"720 at 30 frames/s, measured every {EVERY_S:g} s; WebAssembly is a part of it."
    )
    return Table(heads, rows, title)


def main() -> None:
    """Watch, print, store, and write the page's block."""
    config = read_flags(lambda: tyro.cli(MemoryConfig))
    if not 0 < config.minutes <= MAX_MINUTES:
        raise ParameterError(
            "minutes", f"need more than 0 and at most {MAX_MINUTES:g}, got {config.minutes:g}"
        )
    at_least(0, seed=config.seed)
    with locked(config.out):
        site = config.out / "site"
        build_site(site)
        watched = {}
        take = PageTake("chromium", "paper", 0, config.seed, site, config.kept)
        with film_file(take, take.film()) as display, TemporaryDirectory() as folder:
            room = Path(folder) / "room.y4m"
            write_room(room, config.seed)
            for name, film in (("a room", room), ("a display of `paper`", display)):
                samples = watch_memory(site, film, 60 * config.minutes)
                watched[name] = list(tqdm(samples, name))
    content = {
        "meta": provenance(config.seed, simulated=True),
        "samples": {name: [asdict(s) for s in samples] for name, samples in watched.items()},
    }
    write_json(config.out / "memory.json", content)
    table = memory_table(watched).markdown()
    print(table)
    write_blocks(config.page, {"memory": table})


if __name__ == "__main__":
    run_cli(main)
