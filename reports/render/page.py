"""A stored run -> report.html: one file that needs nothing else, the same bytes every time."""

from collections.abc import Callable
from pathlib import Path

from link.images import write_bytes
from reports.render.markup import Html, join, tag
from reports.render.sections import (
    evidence,
    overview,
    paper,
    peers,
    pictures,
    provenance,
    response,
    sweeps,
)
from reports.run import Run, read_run
from reports.score.findings import standings

REPORT = "report.html"
STYLE = Path(__file__).with_name("report.css")
SECTIONS: dict[str, tuple[str, Callable[[Run], Html]]] = {
    "paper": ("The paper’s tables", paper.paper_tables),
    "sweeps": ("Sweeps", sweeps.sweeps),
    "ablation": ("Ablation", evidence.ablation),
    "peers": ("Other systems", peers.peers),
    "reliability": ("Reliability", evidence.reliability),
    "cdtf": ("CDTF", response.response),
    "pictures": ("Pictures", pictures.pictures),
    "failures": ("Worst failures", pictures.failures),
    "cost": ("Cost", provenance.cost),
    "provenance": ("Provenance", provenance.provenance),
}
"""By anchor: title, and what fills it; after "glance" and "summary"."""


def write_report(folder: Path) -> Path:
    """Build report.html from what a run left in ``folder``; errors as of `stored.read_run`."""
    run = read_run(folder)
    path = folder / REPORT
    write_bytes(path, report(run).encode())
    return path


def report(run: Run) -> str:
    """The page."""
    ranked = standings(run)
    parts = {
        "glance": ("At a glance", overview.glance(run, ranked)),
        "summary": ("Summary", overview.summary(run, ranked)),
    }
    parts |= {anchor: (title, fill(run)) for anchor, (title, fill) in SECTIONS.items()}
    kind = "simulated captures" if run.simulated else "captures of a real display and camera"
    about = run.about
    line = join("By ", tag("code", about["meta"]["command"]))
    if about["commit"]:
        line = join(line, ", commit ", tag("code", about["commit"]))
    head = tag(
        "header",
        tag("h1", "Hidden camera–display decoding, compared"),
        tag("p", f"All numbers are of {kind}. ", line, ".", class_="muted"),
    )
    return page("Hidden camera-display decoding", head, parts)


def page(title: str, head: Html, parts: dict[str, tuple[str, Html]]) -> str:
    """A whole document with navigation.

    Args:
        title: of the document.
        head: what stands above the navigation.
        parts: by anchor: title and content of each section.
    """
    links = [tag("a", name, href=f"#{anchor}") for anchor, (name, _) in parts.items()]
    body = [
        tag("section", tag("h2", name), content, id=anchor)
        for anchor, (name, content) in parts.items()
    ]
    document = tag(
        "html",
        tag(
            "head",
            tag("meta", charset="utf-8"),
            tag("meta", name_="viewport", content="width=device-width, initial-scale=1"),
            tag("title", title),
            tag("style", Html(STYLE.read_text())),
        ),
        tag("body", head, tag("nav", tag("div", *links)), tag("main", *body)),
        lang="en",
    )
    return f"<!doctype html>\n{document}\n"
