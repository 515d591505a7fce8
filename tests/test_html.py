"""The HTML report and the comparison of runs, from stored results."""

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import Command, OpenWindow
from hypothesis import given
from hypothesis import strategies as st
from reports.score.metrics import score, write_metrics

import evaluate
from data_gen.frame_pair import Cell, FramePair, Source
from data_gen.pairs import PAIRS as ALL_PAIRS
from link.captures import save_captures
from link.geometry import homography_from_corners
from link.layout import Layout, make_layout
from link.ratex import training_pixels
from reports.engine.predict import Method
from reports.evaluation.reasons import Parts, block_lumas, explain, take_apart
from reports.evaluation.response import one
from reports.render.markup import VOID, Html, tag
from reports.render.page import SECTIONS, write_report
from reports.render.svg import (
    BOTTOM,
    HEIGHT,
    LABEL_PX,
    MARKERS,
    TOP,
    accuracy_axis,
    marker_of,
    spread,
)
from reports.run import finish, read_run
from reports.score.findings import groups, leaders_of
from reports.score.paired import outcomes
from reports.studies.sweeps import PAIRS, QUICK_PAIRS, SWEEPS, spoken

META = {"simulated": True, "seed": 0, "command": "python evaluate.py"}
TINY = ["--pairs", "canon-lg", "nikon-imac", "--views", "45", "--kappas", "3", "--jobs", "1"]
TINY += ["--quick", "--methods", "naive", "oorc", "hidden_ratex", "learned", "--frames", "2"]
ANCHORS = ["glance", "summary", *SECTIONS]
FETCHED = ("src", "href", "data", "poster", "srcset", "action", "xlink:href")


class Checker(HTMLParser):
    """Collects text and attributes; an element that is closed out of turn fails."""

    def __init__(self, document: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.ids: list[str] = []
        self.attributes: list[tuple[str, str, str]] = []
        self.text: dict[str, str] = {}
        self.section = ""
        self.feed(document)
        self.close()
        assert not self.open

    def handle_starttag(self, name: str, attributes: list[tuple[str, str | None]]) -> None:
        for key, value in attributes:
            self.attributes.append((name, key, value or ""))
            if key == "id":
                self.ids.append(value or "")
        if name == "section":
            self.section = str(dict(attributes)["id"])
        if name not in VOID:
            self.open.append(name)

    def handle_endtag(self, name: str) -> None:
        assert self.open.pop() == name
        if name == "section":
            self.section = ""

    def handle_data(self, data: str) -> None:
        self.text[self.section] = self.text.get(self.section, "") + f" {data}"


def check_page(file: Path) -> Checker:
    """A whole document that loads nothing, every link of which leads to a section."""
    document = file.read_text()
    assert document.startswith("<!doctype html>")
    checker = Checker(document)
    assert len(set(checker.ids)) == len(checker.ids)
    for _, key, value in checker.attributes:
        if key in FETCHED:
            assert value.startswith(("data:image/jpeg;base64,", "#")), value
            assert not value.startswith("#") or value[1:] in checker.ids
    assert not re.search(r"https?://|@import|url\(|<script|<link", document)
    return checker


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A quick run of two cells and two sweeps, by one process."""
    out = tmp_path_factory.mktemp("tiny")
    with pytest.MonkeyPatch.context() as patch:
        sweeps = ["--sweeps", "ratex", "kappa"]
        patch.setattr("sys.argv", ["evaluate.py", *TINY, *sweeps, "--out", str(out)])
        evaluate.main()
    return out


# The page


def test_the_page_has_every_section_and_needs_no_network(tiny: Path) -> None:
    checker = check_page(tiny / "report.html")
    assert [name for name in checker.ids if name in ANCHORS] == ANCHORS
    for anchor in set(ANCHORS) - {"reliability"}:
        assert "not in this run" not in checker.text[anchor], anchor
    assert "All numbers are of simulated captures" in checker.text[""]
    assert (tiny / "report.html").stat().st_size < 8e6


def test_the_numbers_are_those_of_the_metrics(tiny: Path) -> None:
    rows = json.loads((tiny / "metrics.json").read_text())["rows"]
    text = " ".join(check_page(tiny / "report.html").text["summary"].split())
    for method in ("naive", "oorc", "hidden_ratex", "learned"):
        mine = [row for row in rows if row["method"] == method]
        bits, correct = (sum(row[key] for row in mine) for key in ("bits", "correct"))
        assert f"{method} {100 * correct / bits:.2f}" in text
        assert f"{bits - correct:,} of {bits:,}" in text


def test_sweeps_state_every_point_with_its_size(tiny: Path) -> None:
    text = check_page(tiny / "report.html").text["sweeps"]
    run = read_run(tiny)
    assert {point.sweep for point in run.sweeps} == {"ratex", "kappa"}
    for point in run.sweeps:
        assert {row.pair for row in point.rows} == set(QUICK_PAIRS)
        assert {row.frames for row in point.rows} == {1}
        n_bits = {row.method: row.bits for row in point.rows if row.pair == QUICK_PAIRS[0]}
        patches = point.value if point.sweep == "ratex" else 5
        assert n_bits["oorc"] == 64 - patches
        assert n_bits["hidden_ratex"] == 64
        mine = [row for row in point.rows if row.method == "oorc"]
        wrong = sum(row.bits - row.correct for row in mine)
        assert f"{wrong} of {sum(row.bits for row in mine)} bits wrong" in text


def test_the_papers_cells_stand_beside_ours(tiny: Path) -> None:
    text = " ".join(check_page(tiny / "report.html").text["paper"].split())
    assert "98.4 |" in text  # oorc, canon-lg, 45 degrees, kappa 3 in the paper
    assert "95.2 |" in text  # nikon-imac


def test_building_it_again_decodes_nothing_and_gives_the_same_bytes(
    tiny: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(*_: Any, **__: Any) -> None:
        raise AssertionError("decoded or simulated")

    for name in ("reports.engine.predict.make_decoder", "reports.engine.predict.simulate"):
        monkeypatch.setattr(name, forbidden)
    monkeypatch.setattr("reports.evaluation.stories.simulate", forbidden)
    before = (tiny / "report.html").read_bytes()
    (tiny / "report.html").unlink()
    done = command(evaluate.main, "--report", tiny)
    assert done.status == 0, done.stderr
    assert (tiny / "report.html").read_bytes() == before


def test_a_folder_that_moved_gives_the_same_page(tiny: Path, tmp_path: Path) -> None:
    shutil.copytree(tiny, tmp_path / "moved")
    assert write_report(tmp_path / "moved").read_bytes() == (tiny / "report.html").read_bytes()


def test_failures_carry_a_measured_reason(tiny: Path) -> None:
    stories = json.loads((tiny / "stories.json").read_text())
    told = [story for story in stories if story["kind"] == "failure"]
    assert told
    for story in told:
        assert re.match(r"\d+ wrong blocks?: .*gray levels", story["reason"])
        assert set(story["measured"]) >= {"signal of a bit", "noise", "motion left"}
    for story in stories:
        assert all((tiny / file).is_file() for file, _ in story["pictures"])


def test_an_unknown_sweep_is_refused_with_the_valid_names(tmp_path: Path, command: Command) -> None:
    done = command(evaluate.main, "--sweeps", "colour", "--out", tmp_path)
    assert done.status == 2
    assert all(name in done.stderr for name in SWEEPS)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("flags", "expected"),
    [
        ({}, tuple(SWEEPS)),
        ({"frames": 2, "quick": True, "seed": 3, "methods": ("oorc",)}, tuple(SWEEPS)),
        ({"pairs": ("canon-lg",)}, ()),
        ({"set": ("drift=0.1",)}, ()),
        ({"sweeps": ()}, ()),
        ({"pairs": ("canon-lg",), "sweeps": ("jpeg",)}, ("jpeg",)),
    ],
)
def test_sweeps_join_the_reference_comparison_alone(
    flags: dict[str, Any], expected: tuple[str, ...]
) -> None:
    assert evaluate.sweeps_of(evaluate.EvaluateConfig(**flags)) == expected


def test_without_html_nothing_is_drawn(tmp_path: Path, command: Command) -> None:
    run = ("--pairs", "canon-lg", "--views", 0, "--kappas", 5, "--frames", 1, "--methods", "naive")
    assert command(evaluate.main, *run, "--jobs", 1, "--no-html", "--out", tmp_path).status == 0
    assert {file.name for file in tmp_path.iterdir()} == {
        "cells",
        "config.json",
        "metrics.json",
        "predictions.jsonl",
        "tables.md",
    }


def test_the_page_fits_a_phone_and_a_desk(tiny: Path, open_window: OpenWindow) -> None:
    page = open_window(1280, 900)
    for width in (360, 390, 1280):
        page.set_viewport_size({"width": width, "height": 900})
        page.goto((tiny / "report.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") == width
        beyond = page.evaluate(
            "[...document.querySelectorAll('main svg text, main p, main h3, main figcaption')]"
            ".filter(e => !e.closest('.scroll, details')"
            f" && e.getBoundingClientRect().right > {width}).map(e => e.textContent)"
        )
        assert beyond == []
        small = page.evaluate(
            "[...document.querySelectorAll('svg text')].map(e => "
            "parseFloat(getComputedStyle(e).fontSize) * e.ownerSVGElement.getScreenCTM().a)"
        )
        assert min(small) > 8.5  # pixels
    page.set_viewport_size({"width": 718, "height": 900})  # A4 within Chromium's margins
    page.emulate_media(media="print")
    assert page.evaluate("document.documentElement.scrollWidth") == 718
    assert page.evaluate("[...document.images].every(i => i.alt && i.complete)")


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
        folder = tmp_path / name
        folder.mkdir()
        text = "".join(json.dumps(entry) + "\n" for entry in lines)
        (folder / "predictions.jsonl").write_text(text)
        write_metrics(folder / "metrics.json", score(lines), META)
        finish(folder, META, {"seed": 0, "ratex": 5, **settings}, {"decoding": 1.0})
        return folder

    return write


def test_a_run_with_predictions_alone_says_what_it_lacks(store: Store) -> None:
    folder = store("bare", [line("oorc", i, i % 2) for i in range(6)])
    checker = check_page(write_report(folder))
    for anchor in ("sweeps", "reliability", "cdtf", "pictures", "failures", "cost"):
        assert "not in this run" in checker.text[anchor]


def test_other_systems_show_their_better_reading(store: Store) -> None:
    folder = store("peers", [line("oorc", 0, 1)])
    usual = {"method": "toy <1>", "strength": "default", "condition": "0°", "message_bits": 32}
    usual |= {"captures": 10, "bits": 320, "psnr": 36.2, "ssim": 0.99, "decode_ms": 12.0}
    rows = [
        {
            **usual,
            "frames_used": n,
            "correct": c,
            "accuracy": c / 320,
            "ci_low": 0.4,
            "ci_high": 0.9,
        }
        for n, c in ((1, 200), (2, 240))
    ]
    ours = {**rows[1], "method": "oorc", "strength": "κ 3", "message_bits": 59, "accuracy": 0.875}
    meta = {**META, "command": "python -m reports.studies.peers", "blind-watermark": "0.4.4"}
    (folder / "reference").mkdir(exist_ok=True)
    stored = {"meta": meta, "rows": [*rows, ours]}
    (folder / "reference" / "peers.json").write_text(json.dumps(stored))
    text = check_page(write_report(folder)).text["peers"]
    assert "75.0" in text and "62.5" not in text  # of one frame and two
    assert "toy <1>" in text and "blind-watermark 0.4.4" in text
    assert " 32 " in text and " 29.5 " in text  # bits a displayed frame


def test_names_are_escaped(store: Store) -> None:
    evil = '<img src=x onerror="alert(1)">&'
    lines = [line(evil, i, 1, pair="<i>") for i in range(6)]
    checker = check_page(write_report(store("evil", lines, set=["<u>"])))
    assert evil in checker.text["summary"]
    assert "<u>" in checker.text["provenance"]
    assert not any(name == "img" for name, _, _ in checker.attributes)


@given(st.text(), st.text())
def test_text_comes_back_as_it_was(content: str, value: str) -> None:
    plain = content.replace("\r", "").replace("\0", "")

    class Reader(HTMLParser):
        seen = ""
        kept = ""

        def handle_data(self, data: str) -> None:
            self.seen += data

        def handle_starttag(self, name: str, attributes: list[tuple[str, str | None]]) -> None:
            assert name == "p"
            self.kept = dict(attributes)["title"] or ""

    reader = Reader()
    reader.feed(tag("p", plain, title=value))
    reader.close()
    assert reader.seen == plain
    assert reader.kept == value
    assert tag("p", Html("<b>x</b>")) == "<p><b>x</b></p>"


@pytest.mark.parametrize("file", ["predictions.jsonl", "run.json"])
def test_what_is_no_finished_run_is_refused(
    store: Store, command: Command, tmp_path: Path, file: str
) -> None:
    folder = store("cut", [line("oorc", 0, 1)])
    (folder / file).unlink()
    for place in (folder, tmp_path / "nowhere"):
        done = command(evaluate.main, "--report", place)
        assert done.status == 2
        assert done.stderr.startswith(f"error: {place}: holds no finished run")
        assert done.stderr.count("\n") == 1


def test_scores_that_are_not_of_the_predictions_are_refused(store: Store, command: Command) -> None:
    folder = store("mixed", [line("oorc", 0, 1)])
    write_metrics(folder / "metrics.json", score([line("oorc", 0, 2)]), META)
    done = command(evaluate.main, "--report", folder)
    assert done.status == 2
    assert "metrics.json does not score predictions.jsonl" in done.stderr


# Two runs


def test_compare_counts_what_both_decoded(store: Store, command: Command) -> None:
    a = store("a", [line("oorc", i, 3) for i in range(8)] + [line("naive", 0, 1)])
    b = store("b", [line("oorc", i, 1) for i in range(6)] + [line("cnn", 0, 1)])
    done = command(evaluate.main, "--compare", a, b)
    assert done.status == 0, done.stderr
    # 6 shared frame pairs of 10 bits: A has 3 wrong in each, B the first of these
    row = next(text for text in done.stdout.splitlines() if text.startswith("| oorc"))
    cells = [cell.strip() for cell in row.strip("|").split("|")]
    assert cells[:7] == ["oorc", "70.00", "90.00", "+20.00", "+20.00 to +20.00", "0.33", "12 / 0"]
    assert cells[7:] == [f"{2 * 0.5**12:.2g}", "6", "60", "B better"]
    assert "Only in A: naive." in done.stdout
    assert "Only in B: cnn." in done.stdout
    assert "A has 8 frame pairs in its main comparison, B 6; the 6 that both have" in done.stdout
    text = " ".join(check_page(b / "compare.html").text["part0"].split())
    assert "oorc 70.00 90.00 +20.00" in text


def test_compare_says_equal_and_too_few(store: Store, command: Command) -> None:
    lines = [line("oorc", i, 2) for i in range(6)] + [line("naive", i, i) for i in range(4)]
    a, b = store("a", lines), store("b", lines)
    done = command(evaluate.main, "--compare", a, b)
    assert "equal, bit by bit" in done.stdout
    assert "no interval" in done.stdout
    assert "too few frame pairs to tell" in done.stdout


def test_compare_refuses_other_captures(store: Store, command: Command) -> None:
    a = store("a", [line("oorc", i, 1) for i in range(5)])
    for number, (lines, settings, words) in enumerate(
        [
            ([line("oorc", 0, 1)], {"seed": 1}, "has seed 0 and"),
            ([line("oorc", 0, 1)], {"set": ["drift=0.1"]}, "has set None and"),
            ([line("oorc", 0, 1, bits=[1] * 10)], {}, "was sent other bits"),
            ([line("naive", 0, 1)], {}, "share no method"),
        ]
    ):
        b = store(f"b{number}", lines, **settings)
        done = command(evaluate.main, "--compare", a, b)
        assert done.status == 2
        assert words in done.stderr
        assert done.stderr.count("\n") == 1
        assert not (b / "compare.html").exists()


def test_compare_matches_sweeps_by_value(tiny: Path, tmp_path: Path, command: Command) -> None:
    shutil.copytree(tiny, tmp_path / "again")
    done = command(evaluate.main, "--compare", tiny, tmp_path / "again")
    assert done.status == 0, done.stderr
    assert "sweep: Ratex patches" in done.stdout
    assert done.stdout.count("B better") == done.stdout.count("A better") == 0
    frames = len(QUICK_PAIRS) * len(SWEEPS["ratex"].quick)
    rows = done.stdout.split("sweep: Ratex patches")[1].splitlines()
    assert f"| {frames} |" in next(text for text in rows if text.startswith("| oorc"))


# Captures


@pytest.fixture
def filmed(tmp_path: Path) -> Callable[[bool], Path]:
    """A folder of three captures, with their bits or without."""

    def film(known: bool) -> Path:
        source, cell = Source(make_layout()), Cell("nikon-samsung", 60.0, 2)
        captures = [replace(FramePair(source, cell, i).captured, meta={}) for i in range(3)]
        if not known:
            captures = [replace(captured, bits=None) for captured in captures]
        save_captures(tmp_path / "captures", iter(captures))
        return tmp_path / "captures"

    return film


def test_captures_with_unknown_bits_are_shown_and_not_scored(
    filmed: Callable[[bool], Path], tmp_path: Path, command: Command
) -> None:
    run = ("--captures", filmed(False), "--methods", "naive", "oorc", "--out", tmp_path / "out")
    done = command(evaluate.main, *run)
    assert done.status == 0, done.stderr
    checker = check_page(tmp_path / "out" / "report.html")
    assert "bits of these captures are not known" in checker.text["glance"]
    assert "captures of a real display and camera" in checker.text[""]
    assert "not in this run" in checker.text["failures"]
    assert sum(name == "img" and key == "src" for name, key, _ in checker.attributes) == 3 * 3
    assert "%" not in checker.text["pictures"]


def test_captures_with_bits_show_their_failures(
    filmed: Callable[[bool], Path], tmp_path: Path, command: Command
) -> None:
    out = tmp_path / "out"
    run = ("--captures", filmed(True), "--methods", "naive", "--out", out)
    assert command(evaluate.main, *run).status == 0
    (row,) = json.loads((out / "metrics.json").read_text())["rows"]
    checker = check_page(out / "report.html")
    wrong = row["bits"] - row["correct"]
    assert wrong
    assert f"{wrong} of {row['bits']}" in " ".join(checker.text["summary"].split())
    assert "captured level" in checker.text["failures"]
    again = (out / "report.html").read_bytes()
    shutil.rmtree(tmp_path / "captures")
    assert write_report(out).read_bytes() == again


# Parts


def test_methods_are_grouped_by_what_they_saw() -> None:
    lines = [line(m, i, wrong) for m, wrong in (("oorc", 2), ("cnn", 1)) for i in range(3)]
    lines += [line("blind", i, 0, n_bits=12) for i in range(3)]
    assert groups(outcomes(lines)) == [["oorc", "cnn"], ["blind"]]
    assert leaders_of(lines, []) == ["blind", "cnn"]
    assert leaders_of(lines, [score([line("oorc", 0, 0), line("blind", 0, 0)])]) == [
        "blind",
        "oorc",
    ]
    unknown = [line("oorc", 0, 0, bits=[-1] * 10)]
    assert leaders_of(unknown, []) == []


@given(st.lists(st.floats(TOP, HEIGHT - BOTTOM), min_size=1, max_size=9))
def test_labels_keep_their_order_and_their_distance(wanted: list[float]) -> None:
    placed = spread(wanted)
    order = np.argsort(wanted, kind="stable")
    gaps = np.diff([placed[i] for i in order])
    assert np.all(gaps >= LABEL_PX - 1e-6)
    assert min(placed) >= TOP
    if len(wanted) == 1 and wanted[0] >= TOP + 4:
        assert placed == wanted


@given(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
def test_the_scale_of_accuracies_keeps_order(least: float, a: float, b: float) -> None:
    axis = accuracy_axis(least)
    assert axis.low <= max(least, 0.0)
    assert (axis.place(a) <= axis.place(b)) or a > b
    assert axis.place(1.0) == 1.0


def test_markers_tell_neighbours_apart() -> None:
    assert {marker_of(m) for m in ("naive", "two_step", "oorc", "hidden_ratex", "blind")} == set(
        MARKERS
    )


@pytest.mark.parametrize("name", SWEEPS)
def test_every_value_of_a_sweep_can_be_filmed(name: str, layout: Layout) -> None:
    sweep, base = SWEEPS[name], Source(layout)
    assert set(sweep.quick) <= set(sweep.values)
    assert list(sweep.values) == sorted(sweep.values)
    settings = [sweep.setting(name, value, base) for value in sweep.values]
    assert len(set(settings)) == len(settings)
    for source, view, kappa in settings:
        assert FramePair(source, Cell("canon-lg", view, kappa), 0).captured.kappa == kappa
    assert len({spoken(name, value) for value in sweep.values}) == len(sweep.values)


def test_sweeps_use_every_camera_and_display_alike() -> None:
    for pairs, count in ((PAIRS, 2), (QUICK_PAIRS, 1)):
        assert set(pairs) <= set(ALL_PAIRS)
        names = [part for pair in pairs for part in pair.split("-")]
        assert {names.count(name) for name in names} == {count}


def test_the_parts_of_a_frame_pair_add_up(layout: Layout) -> None:
    source, cell = Source(layout), Cell("canon-lg", 45.0, 5)
    parts, captured = take_apart(source, cell, 0, False), FramePair(source, cell, 0).captured
    message = layout.message_mask
    assert np.all(parts.signal[message] > 0)
    assert np.all(np.abs(parts.signal[~message]) < 0.2)  # patches carry no bit
    bits = np.zeros(message.shape)
    bits[message] = captured.bits
    # up to the reported corners, which are half a pixel off
    H = homography_from_corners(captured.corners, layout.width, layout.height)
    seen = block_lumas(captured.embedded, H, layout)
    seen -= block_lumas(captured.original, H, layout)
    expected = bits * parts.signal + parts.drift + parts.motion + parts.noise
    error = (seen - expected)[message]
    assert np.abs(error).mean() < 0.15 * parts.signal[message].mean()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            {"signal": 0.2, "level": 10.0},
            "arrives there as 0.20 gray levels, for the picture",
        ),
        ({"signal": 0.2, "level": 250.0}, "near saturation"),
        ({"noise": 3.0}, "noise changes it by 3.00 gray levels, a bit by 2.00"),
        ({"motion": -3.0}, "motion of 0.70 px over texture changes it by 3.00"),
        ({}, "nothing by half of that"),
    ],
)
def test_the_reason_names_the_largest_obstacle(change: dict[str, float], words: str) -> None:
    wrong = np.zeros((2, 3), bool)
    wrong[1, 2] = True
    usual = {"level": 100.0, "signal": 2.0, "drift": 0.0, "motion": 0.0, "noise": 0.0}
    arrays = {name: np.full(wrong.shape, value) for name, value in usual.items()}
    for name, value in change.items():
        arrays[name][wrong] = value
    reason, found = explain(Parts(**arrays, shift_px=0.7), wrong)
    assert reason.startswith("1 wrong block: ")
    assert words in reason
    for name, value in change.items():
        key = {"level": "captured level", "signal": "signal of a bit"}.get(name, name)
        key = "motion left" if name == "motion" else key
        assert found[key][0] == pytest.approx(abs(value))
    inverted, _ = explain(Parts(**arrays, shift_px=0.7), ~wrong)
    assert "more than half of the bits" in inverted


def test_the_true_response_rises_and_lies_in_its_band(layout: Layout) -> None:
    source, cell = Source(layout), Cell("canon-lg", 45.0, 5)
    found = one(source, cell, 0, [Method("naive"), Method("two_step"), Method("cnn")])
    low, median, high = (np.array(v) for v in (found.low, found.median, found.high))
    assert np.all(np.diff(median) > -1)
    assert np.all((low <= median) & (median <= high))
    assert set(found.found) == set(found.error) == {"naive", "two_step"}
    pixels = training_pixels(layout, 5)
    pair = FramePair(source, cell, 0).rectified
    seen = pair.original[pixels.y, pixels.x].mean()
    assert found.found["naive"][0][1] <= seen <= found.found["naive"][-1][1]
