"""Memory of the page over an hour of messages: python -m lab.page_memory, measured once.

The page runs in Chromium, whose simulated camera plays one film of `hidden` over and over. A
message that has come is dismissed, so that the page reads it again. Every few seconds the memory of
the process that runs the page is taken from the system.

Needs Linux, Node.js, Playwright and Chromium.
"""

import json
import os
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import tyro

from export.web.site import build_site
from lab.films.browser import camera_flags, open_chromium, serve_folder, text_of
from link.cli import read_flags, run_cli

MIB = 2**20
"""Number of bytes in a mebibyte."""
EVERY_S = 5.0
"""Time from one measurement to the next, seconds."""


@dataclass(frozen=True)
class MemoryConfig:
    """Watch the page's memory before a camera (simulated)."""

    film: Path
    """A .y4m file that Chromium's camera plays (`lab page --by chromium --kept`)."""
    minutes: float = 61.0
    """Time for which the film is watched, minutes."""
    out: Path = Path("runs/page_memory")
    """Folder of the site and of memory.jsonl."""


def renderer_bytes(chromium: int) -> int:
    """Memory, in bytes of RAM, of the largest renderer among a browser's descendants."""
    parents, sizes = {}, {}
    for status in Path("/proc").glob("[0-9]*/status"):
        try:
            lines = dict(
                line.split(":", 1) for line in status.read_text().splitlines() if ":" in line
            )
            words = (status.parent / "cmdline").read_bytes()
        except OSError:
            continue
        number = int(status.parent.name)
        parents[number] = int(lines["PPid"])
        if b"--type=renderer" in words:
            sizes[number] = 1024 * int(lines["VmRSS"].split()[0])

    def descends(number: int) -> bool:
        while number in parents:
            if number == chromium:
                return True
            number = parents[number]
        return False

    return max((size for number, size in sizes.items() if descends(number)), default=0)


def main() -> None:
    """Watch, and write a line every few seconds."""
    config = read_flags(lambda: tyro.cli(MemoryConfig))
    site = config.out / "site"
    config.out.mkdir(parents=True, exist_ok=True)
    build_site(site)
    with (
        serve_folder(site) as address,
        open_chromium(camera_flags(config.film)) as page,
        (config.out / "memory.jsonl").open("w") as lines,
    ):
        page.goto(address)
        start, messages = perf_counter(), 0
        while (now := perf_counter() - start) < 60 * config.minutes:
            page.wait_for_timeout(1000 * EVERY_S)
            if not page.evaluate("document.getElementById('letter').hidden"):
                messages += 1
                page.locator("#again").click()
            seen = renderer_bytes(os.getpid()) / MIB
            heap = page.evaluate("performance.memory.usedJSHeapSize") / MIB
            status = text_of(page, "status")
            row = {"s": now, "mib": seen, "heap": heap, "messages": messages, "status": status}
            lines.write(json.dumps(row) + "\n")
            lines.flush()


if __name__ == "__main__":
    run_cli(main)
