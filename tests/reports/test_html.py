"""The HTML report and the comparison of runs, from stored results."""

import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path
from typing import Any

import html5lib
import pytest
from conftest import Command, MakeOnce, OpenWindow, Refuses, run_main
from hypothesis import given
from hypothesis import strategies as st

import evaluate
from reports.engine.checked import write_json, write_sealed
from reports.engine.records import to_records
from reports.evaluation.html import render
from reports.evaluation.page import SECTIONS, ranked_comparisons, write_report
from reports.render.charts import (
    ACCURACY_TICKS,
    Series,
    accuracy_from_scale,
    accuracy_scale,
    accuracy_ticks,
    draw_series,
    in_style,
    look_of,
    new_panels,
    to_svg,
)
from reports.render.tables import Table, TableCell
from reports.run import CSV, PREDICTIONS, STORIES, RunFolder, Story

META = {"simulated": True, "seed": 0, "command": "python evaluate.py"}
MACHINE_FREE = ("src", "href", "data", "poster", "srcset", "action", "xlink:href")
"""Attributes by which a document loads something."""
TINY = ["--pairs", "canon-lg", "nikon-imac", "--views", "45", "--kappas", "3", "--jobs", "1"]
TINY += ["--methods", "naive", "oorc", "hidden_ratex", "learned", "--frames", "2"]


class Checked:
    """A document as html5lib, which reads as browsers do and raises on any error of syntax."""

    def __init__(self, document: str) -> None:
        parser = html5lib.HTMLParser(strict=True, namespaceHTMLElements=False)
        self.root: ET.Element = parser.parse(document)
        self.elements = list(self.root.iter())
        self.ids = [element.attrib["id"] for element in self.elements if "id" in element.attrib]
        sections = {section.attrib["id"]: section for section in self.root.iter("section")}
        self.text = {anchor: text_of(section) for anchor, section in sections.items()}

    @property
    def header(self) -> str:
        """Text above the sections."""
        return text_of(self.root.find("body/header"))


def text_of(element: ET.Element | None) -> str:
    """All texts of an element, spaced as one line."""
    return " ".join(" ".join(element.itertext()).split())


def check_page(file: Path) -> Checked:
    """A whole document that loads nothing, every link of which leads to a section."""
    document = file.read_text()
    assert document.startswith("<!doctype html>")
    checked = Checked(document)
    assert len(set(checked.ids)) == len(checked.ids)
    for element in checked.elements:
        for key, value in element.attrib.items():
            if str(key).rpartition("}")[2] in MACHINE_FREE:
                within = ("data:image/jpeg;base64,", "#", CSV)  # the one file that lies beside it
                assert value.startswith(within), value
                assert not value.startswith("#") or value[1:] in checked.ids
    assert not re.search(r"https?://|@import|<script|<link|url\((?!#)", document)
    return checked


@pytest.fixture(scope="module")
def tiny(make_once: MakeOnce) -> Path:
    """A run of two cells, by one process; tests only read it."""

    def fill(folder: Path) -> None:
        run_main(evaluate.main, *TINY, "--out", folder)

    return make_once("tiny", fill)


# The page


@pytest.mark.slow
def test_the_page_has_every_section_and_needs_no_network(tiny: Path) -> None:
    checked = check_page(tiny / "report.html")
    shown = {name: title for name, title in SECTIONS.items() if name not in ("ablation", "films")}
    assert [name for name in checked.ids if name in SECTIONS] == list(shown)
    headings = [text_of(heading) for heading in checked.root.iter("h2")]
    assert headings == list(shown.values())
    assert "All numbers are of simulated captures" in checked.header
    assert (tiny / "report.html").stat().st_size < 8e6


@pytest.mark.slow
def test_the_papers_cells_stand_beside_ours(tiny: Path) -> None:
    text = check_page(tiny / "report.html").text["paper"]
    assert re.search(r"±\d+\.\d 98\.4", text)  # oorc, canon-lg, 45 degrees, kappa 3 in the paper
    assert re.search(r"±\d+\.\d 95\.2", text)  # nikon-imac


@pytest.mark.slow
def test_building_it_again_decodes_nothing_and_gives_the_same_bytes(
    tiny: Path, tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(*_: Any, **__: Any) -> None:
        raise AssertionError("decoded or simulated")

    for name in ("reports.engine.methods.make_decoder", "data_gen.frame_pair.capture"):
        monkeypatch.setattr(name, forbidden)
    again = shutil.copytree(tiny, tmp_path / "again")
    before = (tiny / "report.html").read_bytes()
    (again / "report.html").unlink()
    command(evaluate.main, "--report", again)
    assert (again / "report.html").read_bytes() == before


def test_without_html_nothing_is_drawn(tmp_path: Path, command: Command) -> None:
    run = ("--pairs", "canon-lg", "--views", 0, "--kappas", 5, "--frames", 1, "--methods", "naive")
    command(evaluate.main, *run, "--jobs", 1, "--no-html", "--out", tmp_path)
    assert {file.name for file in tmp_path.iterdir()} == {
        "config.json",
        "metrics.json",
        "metrics.csv",
        "predictions.jsonl",
        "run.json",
        "tables.md",
    }


@pytest.mark.slow
def test_the_page_fits_a_phone_and_a_desk(tiny: Path, open_window: OpenWindow) -> None:
    for width in (360, 1280):
        window = open_window(width, 900)
        window.goto((tiny / "report.html").as_uri())
        assert window.evaluate("document.documentElement.scrollWidth") == width
        beyond = window.evaluate(
            "[...document.querySelectorAll('main svg text, main p, main h3, main figcaption')]"
            ".filter(e => !e.closest('.scroll')"
            f" && e.getBoundingClientRect().right > {width}).map(e => e.textContent)"
        )
        assert beyond == []
        small = window.evaluate(
            "[...document.querySelectorAll('svg text')].map(e => "
            "parseFloat(getComputedStyle(e).fontSize) * e.ownerSVGElement.getScreenCTM().a)"
        )
        assert min(small) > 8.5  # pixels
    window.set_viewport_size({"width": 718, "height": 900})  # A4 within Chromium's margins
    window.emulate_media(media="print")
    assert window.evaluate("document.documentElement.scrollWidth") == 718
    assert window.evaluate("[...document.images].every(i => i.alt && i.complete)")


@pytest.mark.slow
def test_text_and_lines_of_charts_follow_a_dark_screen(tiny: Path, open_window: OpenWindow) -> None:
    shown = []
    for scheme in ("light", "dark"):
        window = open_window(390, 900)
        window.emulate_media(color_scheme=scheme)
        window.goto((tiny / "report.html").as_uri())
        shown.append(
            window.evaluate(
                "[getComputedStyle(document.body).color, ...[...document.querySelectorAll("
                "'figure svg text')].map(e => getComputedStyle(e).fill)]"
            )
        )
    assert all(light != dark for light, dark in zip(*shown, strict=True))


# Stored by hand


def line(method: str, index: int, wrong: int, n_bits: int = 10, **changes: Any) -> dict[str, Any]:
    """A prediction whose first ``wrong`` bits are wrong; the bits themselves follow the index."""
    bits = [(index + i) % 2 for i in range(n_bits)]
    scores = [(1 if bit else -1) * (-1 if i < wrong else 1) for i, bit in enumerate(bits)]
    cell = {"method": method, "pair": "canon-lg", "view_deg": 45.0, "kappa": 3, "index": index}
    return {**cell, "picture": "p", "bits": bits, "scores": scores, **changes}


Store = Callable[..., Path]


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """Write a run as evaluate.py leaves it."""

    def write(name: str, lines: list[dict[str, Any]], **settings: Any) -> Path:
        folder = RunFolder(tmp_path / name)
        decisive = {"seed": 0, "ratex": 5, **settings}
        folder.claim(decisive)
        write_sealed(folder.path / PREDICTIONS, lines)
        folder.write_comparison(to_records(lines), META, "tables")
        folder.finish(META, {"decoding": 1.0}, [])
        return folder.path

    return write


def test_a_page_has_no_section_for_what_its_run_did_not_measure(store: Store) -> None:
    folder = store("bare", [line("oorc", i, i % 2) for i in range(6)])
    checked = check_page(write_report(folder))
    kept = ["summary", "paper", "provenance"]
    assert [name for name in checked.ids if name in SECTIONS] == kept
    linked = [a.attrib["href"] for nav in checked.root.iter("nav") for a in nav.iter("a")]
    assert linked == [f"#{name}" for name in kept]


def test_names_are_escaped(store: Store) -> None:
    evil = '<img src=x onerror="alert(1)">& $x$ {{ 7 * 7 }}\x0c'
    lines = [line(evil, i, 1, pair="<i>") for i in range(6)]
    checked = check_page(write_report(store("evil", lines, set=["<u>"])))
    assert evil.strip() in checked.text["summary"]
    assert "<u>" in checked.text["provenance"]
    assert not list(checked.root.iter("img"))


READABLE = st.text(st.characters(exclude_categories=["Cs", "Cc", "Cn", "Co"]))
"""Texts of characters that HTML may hold, without control characters."""


@given(READABLE, READABLE)
def test_texts_of_a_table_come_back_as_they_were(head: str, content: str) -> None:
    table = Table([head, "n"], [[content, TableCell("1", content, "good")]])
    text = render(
        "compare.html.j2",
        {},
        runs={},
        simulated=True,
        compared=table,
        notes=[content],
        sections={"compared": content, "notes": "Notes"},
    )
    root = Checked(text).root
    first, _ = root.iter("th")
    assert "".join(first.itertext()) == head
    cell, number = root.iter("td")
    assert "".join(cell.itertext()) == content
    assert "".join(number.itertext()) == f"1{content}"
    assert number.attrib["class"] == "n good"


def test_legends_have_one_order_whatever_a_chart_shows() -> None:
    named = ["mine", "naive", "oorc", "learned"]
    for heights in ((1.0, 2.0, 3.0, 4.0), (4.0, 1.0, 3.0, 2.0)):
        _, (panel,) = new_panels()
        lines = [Series(n, [0.0], [y], [(y, y)]) for n, y in zip(named, heights, strict=True)]
        draw_series(panel, [lines[0], *lines[:0:-1]])
        legend = panel.get_legend()
        assert [text.get_text() for text in legend.get_texts()] == named


def test_a_chart_says_its_title_and_is_the_same_again() -> None:
    @in_style
    def chart() -> str:
        figure, (panel,) = new_panels()
        panel.set(xlim=(0, 2), ylim=(0, 1))
        draw_series(panel, [Series("a <b> $c$", [1.0], [0.5], [(0.4, 2.0)])])
        return str(to_svg(figure, "A <title>"))

    root = ET.fromstring(chart())
    titles = [title.text for title in root.iter("title")]
    assert titles == ["A <title>"]
    assert (root.attrib["role"], root.attrib["aria-label"]) == ("img", "A <title>")
    assert "a <b> $c$" in [text.text for text in root.iter("text")]
    assert chart() == chart()


@pytest.mark.parametrize("file", ["predictions.jsonl", "run.json"])
def test_what_is_no_finished_run_is_refused(
    store: Store, refuses: Refuses, tmp_path: Path, file: str
) -> None:
    folder = store("cut", [line("oorc", 0, 1)])
    (folder / file).unlink()
    for place in (folder, tmp_path / "nowhere"):
        refuses("evaluate", ["--report", place], f"error: {place}: holds no finished run")


@pytest.mark.parametrize("file", ["../secret.jpg", "stories/gone.jpg"])
def test_pictures_outside_the_run_or_missing_are_refused(
    store: Store, refuses: Refuses, file: str
) -> None:
    folder = store("stories", [line("oorc", 0, 1)])
    (folder.parent / "secret.jpg").write_bytes(b"secret")
    write_json(folder / STORIES, [Story("oorc", "where", [(file, "caption")])])
    refuses("evaluate", ["--report", folder], file, folder=folder)


# Two runs


def test_compare_counts_what_both_decoded(store: Store, command: Command) -> None:
    a = store("a", [line("oorc", i, 3) for i in range(8)] + [line("naive", 0, 1)])
    b = store("b", [line("oorc", i, 1) for i in range(6)] + [line("phi", 0, 1)])
    done = command(evaluate.main, "--compare", a, b)
    # 6 shared frame pairs of 10 bits: A has 3 wrong in each, B the first of these
    row = next(text for text in done.stdout.splitlines() if text.startswith("| oorc"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[:7] == ["oorc", "70.00", "90.00", "+20.00", "+20.00 to +20.00", "0.33", "12 / 0"]
    assert cells[7:] == [f"{2 * 0.5**12:.2g}", "6", "60"]
    assert "Only in A: naive." in done.stdout
    assert "Only in B: phi." in done.stdout
    assert "A has 8 frame pairs in its main comparison, B 6; the 6 that both have" in done.stdout
    assert "oorc 70.00 90.00 +20.00" in check_page(b / "compare.html").text["compared"]


def test_compare_matches_captures_whose_cell_is_unknown(store: Store, command: Command) -> None:
    a, b = (
        store(name, [line("oorc", i, wrong, view_deg=None, kappa=None) for i in range(6)])
        for name, wrong in (("a", 3), ("b", 1))
    )
    done = command(evaluate.main, "--compare", a, b)
    assert "| 6 | 60 |" in done.stdout


def test_compare_gives_no_interval_of_few_frame_pairs(store: Store, command: Command) -> None:
    lines = [line("naive", i, i) for i in range(4)]
    done = command(evaluate.main, "--compare", store("a", lines), store("b", lines))
    assert "no interval" in done.stdout


def test_compare_refuses_other_captures(store: Store, refuses: Refuses) -> None:
    a = store("a", [line("oorc", i, 1) for i in range(5)])
    for number, (lines, settings, words) in enumerate(
        [
            ([line("oorc", 0, 1)], {"seed": 1}, "has seed 0 and"),
            ([line("oorc", 0, 1)], {"set": ["drift=0.1"]}, "has set None and"),
            ([line("oorc", 0, 1)], {"modulation": "antipodal"}, "has modulation None and"),
            ([line("oorc", 0, 1, bits=[1] * 10)], {}, "was sent other bits"),
            ([line("naive", 0, 1)], {}, "share no method"),
        ]
    ):
        b = store(f"b{number}", lines, **settings)
        refuses("evaluate", ["--compare", a, b], words, folder=b)


# Comparisons, and the scale of charts


def test_methods_of_other_captures_are_not_held_against_each_other(store: Store) -> None:
    frames = range(5)
    lines = [line(method, i, 1) for method in ("oorc", "two_step") for i in frames]
    run = RunFolder(store("unlike", [*lines, *(line("blind", i, 1, 20) for i in frames)])).read()
    compared = ranked_comparisons(run)
    assert list(compared) == ["blind", "oorc", "two_step"]
    assert compared["oorc"] is compared["blind"] is None
    assert compared["two_step"] is not None and compared["two_step"].difference == 0


def test_conditions_are_summed_up_apart(store: Store) -> None:
    lines = [line("oorc", i, 1) | {"condition": f"kind {i % 2}"} for i in range(6)]
    lines += [line("film", i, 1) | {"condition": "kind 1"} for i in (1, 3, 5)]
    parts = RunFolder(store("kinds", lines)).read().by_condition
    assert list(parts) == ["kind 0", "kind 1"]
    ranked = [list(ranked_comparisons(part)) for part in parts.values()]
    assert ranked == [["oorc"], ["oorc", "film"]]


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_the_scale_of_accuracies_keeps_order(least: float, a: float, b: float) -> None:
    ticks = accuracy_ticks(least)
    assert ticks[0] <= least and len(ticks) > 1  # an axis of one height has none
    assert ticks == sorted(set(ticks)) and set(ticks) <= set(ACCURACY_TICKS)
    assert ticks[-1] == 1.0
    low, high = accuracy_scale([a, b])
    assert low <= high or a > b
    assert accuracy_from_scale(low) == pytest.approx(a, abs=1e-9)


def test_colours_and_markers_tell_neighbours_apart() -> None:
    methods = ("naive", "two_step", "oorc", "hidden_ratex", "blind")
    assert len({look_of(method).marker for method in methods}) == len(methods)
    assert len({look_of(method).colour for method in methods}) == len(methods)
    assert look_of("not a method") == look_of("not a method")
