import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import Command, MakeOnce, cases, run_main
from numpy.typing import NDArray
from scipy.stats import binomtest
from tolerances import FLOAT64

import evaluate
from data_gen.frame_pair import Cell, Source
from data_gen.pairs import PAIRS
from link.frames import SoftBits
from link.layout import Layout, make_layout
from link.observation import Observation
from reports.engine import predict as engine
from reports.engine.backends import Backend
from reports.engine.checked import seal
from reports.engine.methods import Method
from reports.engine.predict import Condition, predict_all
from reports.engine.records import to_records
from reports.render.figures import RIGHT, UNKNOWN, WRONG, annotate
from reports.render.tables import cell_tables, summary_table
from reports.score.accuracy import pool, read_scores, score, write_scores
from reports.score.intervals import clustered_interval, wilson
from reports.score.paper import PRINTED

ONE_PAIR = ["--pairs", "canon-lg", "--kappas", "5", "--no-html"]
TINY = [*ONE_PAIR, "--views", "0", "--frames", "2", "--methods"]
TINY += ["naive", "oorc", "phi", "hidden_ratex"]


def no_constants(name: str) -> None:
    raise AssertionError(f"metrics.json holds {name}, which is not JSON")


def read_strictly(file: Path) -> dict[str, Any]:
    return json.loads(file.read_text(), parse_constant=no_constants)


# The protocol, end to end


@pytest.fixture(scope="module")
def evaluated(make_once: MakeOnce) -> Path:
    """The tiny protocol, by one process; tests only read it."""

    def fill(folder: Path) -> None:
        run_main(evaluate.main, *TINY, "--jobs", 1, "--out", folder)

    return make_once("evaluation", fill)


def test_metrics_hold_the_fields_of_the_format(evaluated: Path) -> None:
    metrics = read_strictly(evaluated / "metrics.json")
    assert set(metrics) == {"meta", "rows"}
    meta = metrics["meta"]
    assert meta["simulated"] is True
    assert meta["seed"] == 0
    assert meta["command"].startswith("python evaluate.py --pairs canon-lg")
    assert {"python", "torch", "numpy", "onnxruntime", "scikit-learn"} <= set(meta)
    needed = {"method", "pair", "view_deg", "kappa", "bits", "correct", "accuracy"}
    assert all(needed | {"ci_low", "ci_high"} <= set(row) for row in metrics["rows"])


def test_rows_are_consistent(evaluated: Path) -> None:
    rows = read_strictly(evaluated / "metrics.json")["rows"]
    bits = {row["method"]: row["bits"] for row in rows}
    assert bits == {"naive": 118, "oorc": 118, "phi": 118, "hidden_ratex": 128}  # 2 x 59, 2 x 64
    for row in rows:
        assert row["accuracy"] == row["correct"] / row["bits"]
        assert 0.5 < row["ci_low"] <= row["accuracy"] <= row["ci_high"] <= 1  # beyond chance
        assert (row["pair"], row["view_deg"], row["kappa"]) == ("canon-lg", 0.0, 5)
        assert row["frames"] == 2
    predictions = pd.read_json(evaluated / "predictions.jsonl", lines=True)
    assert len(predictions) == 2 * 4
    for method, mine in predictions.groupby("method"):
        right = (np.concatenate([*mine["scores"]]) > 0) == np.concatenate([*mine["bits"]])
        assert right.sum() == next(row["correct"] for row in rows if row["method"] == method)


def test_the_report_is_printed_and_kept(evaluated: Path) -> None:
    tables = (evaluated / "tables.md").read_text()
    assert "| canon-lg |" in tables
    assert "/ 97.1" in tables  # naive, canon-lg, 0 degrees, kappa 5 in the paper
    assert "simulated" in tables


# Metrics


@cases((0, 1), (59, 59), (50, 59), (1764, 1800))
def test_wilson_is_scipys(correct: int, bits: int) -> None:
    expected = binomtest(correct, bits).proportion_ci(0.95, method="wilson")
    np.testing.assert_allclose(
        wilson(correct, bits), (expected.low, expected.high), rtol=0, atol=FLOAT64
    )


def test_wilson_knows_nothing_without_a_trial() -> None:
    assert wilson(0, 0) == (0.0, 1.0)


def prediction(scores: list[float], bits: list[int], **changes: Any) -> dict[str, Any]:
    cell = {"method": "oorc", "pair": "canon-lg", "view_deg": 0.0, "kappa": 5, "index": 0}
    return {**cell, "scores": scores, "bits": bits, **changes}


def test_score_counts_bits_by_the_sign_of_the_score() -> None:
    rows = score(
        to_records(
            [
                prediction([1.0, -1.0, 0.5, -0.5], [1, 0, 0, 1]),
                prediction([2.0, 2.0, 2.0, 2.0], [1, 1, 1, 0], index=1),
                prediction([1.0], [1], method="naive"),
            ]
        )
    )
    counted = rows[["method", "frames", "bits", "correct"]].to_numpy().tolist()
    assert counted == [["oorc", 2, 8, 5], ["naive", 1, 1, 1]]
    assert rows["accuracy"][0] == 5 / 8


def test_unknown_bits_do_not_count(tmp_path: Path) -> None:
    unknown = {"pair": "captures", "view_deg": None, "kappa": None}
    rows = score(
        to_records(
            [prediction([1.0, 1.0, 1.0], [1, -1, -1]), prediction([1.0, 1.0], [-1, -1], **unknown)]
        )
    )
    assert rows[["bits", "correct"]].to_numpy().tolist() == [[1, 1], [0, 0]]
    assert rows["accuracy"][0] == 1.0
    assert np.isnan(rows["accuracy"][1])
    write_scores(tmp_path / "metrics.json", rows, {"seed": 3})
    written = read_strictly(tmp_path / "metrics.json")["rows"][1]
    assert written["accuracy"] is written["view_deg"] is written["kappa"] is None
    assert (written["ci_low"], written["ci_high"]) == (0.0, 1.0)
    read, meta = read_scores(tmp_path / "metrics.json")
    assert meta == {"seed": 3}
    pd.testing.assert_frame_equal(read, rows)


def damaged_cells(line: dict[str, Any]) -> dict[str, bytes]:
    """Contents that are not what a run stored, by what is wrong with them."""
    known = {key: value for key, value in line.items() if key != "sha256"}
    flipped = known | {"scores": [-known["scores"][0], *known["scores"][1:]]}
    sealed = {
        "another shape": {"x": 1},
        "another frame pair": known | {"index": 1},
        "another cell": known | {"kappa": 4},
        "bits beyond 1": known | {"bits": [2, *known["bits"][1:]]},
        "huge": known | {"scores": [10**400, *known["scores"][1:]]},
    }
    plain = {
        "no digest": known,
        "a changed score": flipped | {"sha256": line["sha256"]},
        "nothing": None,
    }
    text = json.dumps(line)
    return {
        **{name: seal(content).encode() for name, content in sealed.items()},
        **{name: json.dumps(content).encode() + b"\n" for name, content in plain.items()},
        "NaN": text.replace(str(known["scores"][0]), "NaN", 1).encode(),
        "two lines": (text + "\n" + text + "\n").encode(),
        "deep": b"[" * 10**5,
        "binary": b"\xff\xfe",
        "cut off": text[:-9].encode(),
    }


def test_a_stored_cell_that_is_corrupted_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    condition = Condition("", Source(make_layout()), (Cell("canon-lg", 0.0, 5),), 1)
    file = tmp_path / "predictions.jsonl"

    def decoded() -> list[dict[str, Any]]:
        return predict_all([condition], [Method("naive")], file, Backend()).astype(str).to_dict()

    expected = decoded()
    stored, time_ns = file.read_bytes(), file.stat().st_mtime_ns
    assert decoded() == expected
    assert file.stat().st_mtime_ns == time_ns  # what is whole is not made again
    line = json.loads(stored)
    del line["sha256"]
    monkeypatch.setattr(engine, "decode_cell", lambda task: ([line], {}))  # decoding takes long
    for name, content in damaged_cells(json.loads(stored)).items():
        file.write_bytes(content)
        assert decoded() == expected, name
        assert file.read_bytes() == stored, name


def interval_of(bits: NDArray[np.int64], right: NDArray[np.int64]) -> tuple[float, float]:
    """The clustered interval of frame pairs with these numbers of bits, and of right ones."""
    squares = [int(a @ b) for a, b in ((bits, bits), (bits, right), (right, right))]
    return clustered_interval(int(bits.sum()), int(right.sum()), *squares)


def test_the_interval_widens_where_errors_cluster() -> None:
    bits = np.full(10, 59)
    spread = interval_of(bits, np.full(10, 58))
    clustered = interval_of(bits, np.array([59] * 9 + [49]))
    assert spread == pytest.approx(wilson(580, 590))
    assert np.diff(clustered) > 2 * np.diff(spread)


@pytest.mark.parametrize("least", [59, 6])  # frame pairs may have unknown bits, windows any number
def test_the_clustered_interval_covers_the_mean_of_clustered_frames(least: int) -> None:
    rng = np.random.default_rng(0)
    covered, widths = 0, []
    for _ in range(400):
        bits = rng.integers(least, 60, size=60)
        right = rng.binomial(bits, rng.beta(18, 2, size=60))  # mean 0.9, strongly clustered
        low, high = interval_of(bits, right)
        covered += low <= 0.9 <= high
        widths.append(high - low)
    assert covered >= 360  # nominal 380
    assert np.mean(widths) < 0.06


def score_row(
    method: str, pair: str, view_deg: float | None, kappa: int | None, *tally: int
) -> pd.DataFrame:
    """A score table of one row, from frames, bits, right bits and the sum of their squares."""
    frames, bits, correct, squared = tally
    equal = {"bits_squared": bits**2 // frames, "bits_correct": bits * correct // frames}
    scores, truth = [1.0] * bits, [1] * correct + [0] * (bits - correct)
    line = prediction(scores, truth, method=method, pair=pair, view_deg=view_deg, kappa=kappa)
    row = score(to_records([line]))
    return row.assign(frames=frames, correct_squared=squared, **equal)


def score_table(*rows: pd.DataFrame) -> pd.DataFrame:
    return pd.concat(rows, ignore_index=True)


def test_cells_are_pooled_by_their_bits() -> None:
    table = score_table(
        score_row("oorc", "canon-lg", 0.0, 5, 2, 100, 90, 90**2 // 2),
        score_row("oorc", "canon-imac", 0.0, 5, 1, 50, 50, 50**2),
        score_row("naive", "canon-lg", 0.0, 5, 2, 100, 100, 100**2 // 2),
    )
    pooled = pool(table).set_index("method")
    assert pooled.index.tolist() == ["oorc", "naive"]
    assert pooled.loc["oorc", ["frames", "bits", "errors"]].tolist() == [3, 150, 10]
    assert pooled.loc["oorc", "accuracy"] == 140 / 150
    printed = [PRINTED[pair, 0, 5, "oorc"] for pair in ("canon-lg", "canon-imac")]
    assert abs(pooled.loc["oorc", "paper"] - np.mean(printed)) < FLOAT64
    assert len(pool(table, ["method", "pair"])) == 3


# The paper's numbers and the tables


@cases(
    ("canon-lg", 45, 3, "oorc", 98.44),
    ("sony-samsung", 45, 3, "two_step", 79.11),
    ("sony-imac", 0, 3, "hidden_ratex", 70.0),
    ("sony-samsung", 0, 5, "hidden_ratex", 90.28),
)
def test_cells_of_the_papers_tables(
    pair: str, view: int, kappa: int, method: str, percent: float
) -> None:
    assert abs(PRINTED[pair, view, kappa, method] - percent / 100) < FLOAT64


@cases(
    (45, 3, "naive", 56.16),  # the cells give 56.164
    (45, 5, "hidden_ratex", 92.86),  # the paper prints 93.71
    (0, 3, "naive", 83.65),  # the paper prints 83.56,
)
def test_column_means_of_the_papers_tables(
    view: int, kappa: int, method: str, percent: float
) -> None:
    cells = [PRINTED[pair, view, kappa, method] for pair in PAIRS]
    assert round(100 * float(np.mean(cells)), 2) == percent


def all_cells(method: str) -> pd.DataFrame:
    return score_table(*(score_row(method, pair, 45.0, 3, 1, 59, 58, 58**2) for pair in PAIRS))


def test_tables_print_the_papers_number_beside_ours() -> None:
    rows = score_table(
        score_row("oorc", "canon-lg", 45.0, 3, 1, 59, 58, 58**2),
        score_row("learned", "canon-lg", 45.0, 3, 1, 59, 59, 59**2),
        score_row("naive", "canon-imac", 45.0, 3, 1, 59, 30, 30**2),
    )
    (table,) = cell_tables(rows)
    lines = table.markdown().splitlines()
    assert lines[0].startswith("κ = 3, 45°")
    assert "| pair | oorc | learned | naive |" in lines
    half = 50 * (rows["ci_high"][0] - rows["ci_low"][0])
    assert lines[4] == f"| canon-lg | 98.3 ±{half:.1f} / 98.4 | 100.0 ±3.1 | – |"
    assert lines[5].startswith("| canon-imac | – | – | 50.8 ±")
    assert lines[5].endswith(" / 72.9 |")


@pytest.mark.parametrize("method", ["naive", "two_step", "oorc", "hidden_ratex"])
def test_the_summary_prints_the_papers_mean(method: str) -> None:
    mean = np.mean([PRINTED[pair, 45, 3, method] for pair in PAIRS])
    line = summary_table(all_cells(method), "title").markdown().splitlines()[-1]
    assert line.startswith(f"| {method} | 98.31 | ")
    assert line.endswith(f"| 531 | {100 * mean:.2f} |")


def test_the_summary_prints_no_mean_where_the_paper_lacks_a_cell() -> None:
    other = score_row("oorc", "canon-lg", 30.0, 3, 1, 59, 58, 58**2)
    rows = score_table(all_cells("oorc"), other)
    assert summary_table(rows, "title").markdown().endswith("| 590 | – |")
    unknown = score_row("oorc", "captures", None, None, 1, 0, 0, 0)
    assert (
        summary_table(unknown, "title")
        .markdown()
        .endswith("| bits |\n|---|---:|---:|---:|\n| oorc | – | – | 0 |")
    )


# Annotated pictures


def decided(layout: Layout, *ones: int) -> SoftBits:
    scores = np.full(layout.n_bits, -1.0)
    scores[list(ones)] = 1.0
    return SoftBits(scores)


def test_annotated_frames_are_green_where_right_red_where_wrong_blue_where_unknown(
    rectified: Observation,
) -> None:
    layout = rectified.layout
    truth = np.zeros(layout.n_bits, np.intp)
    truth[2] = -1
    picture = annotate(rectified, decided(layout, 1), truth)  # bit 1 is wrong
    assert picture.shape == (384, 3 * 512, 3)
    assert picture.dtype == np.uint8
    panel = picture[:, 2 * 512 :]
    cells = np.argwhere(layout.message_mask)
    for bit, colour in ((0, RIGHT), (1, WRONG), (2, UNKNOWN), (3, RIGHT)):
        top, _, left, _ = layout.cell_box(*cells[bit])
        assert tuple(panel[top + 2, left + 2]) == colour


def test_everything_is_unknown_without_the_truth(rectified: Observation) -> None:
    panel = annotate(rectified, decided(rectified.layout))[:, 2 * 512 :]
    for row, col in np.argwhere(rectified.layout.message_mask):
        top, bottom, left, right = rectified.layout.cell_box(row, col)
        assert tuple(panel[top + 2, left + 2]) == tuple(panel[bottom - 3, right - 3]) == UNKNOWN


def test_panels_show_the_original_the_change_and_the_bits(rectified: Observation) -> None:
    layout = rectified.layout
    picture = annotate(rectified, decided(layout, 1))
    assert np.array_equal(picture[:, :512], rectified.original)
    change, panel = picture[:, 512:1024], picture[:, 1024:]
    assert abs(np.median(change.astype(int)) - 128) <= 8
    same = annotate(
        Observation.still(rectified.original, rectified.original, layout), decided(layout)
    )
    assert np.all(same[:, 512:1024] == 128)
    for row, col in layout.ratex:  # left as they are
        top, bottom, left, right = layout.cell_box(row, col)
        assert np.array_equal(
            panel[top:bottom, left:right], rectified.original[top:bottom, left:right]
        )
    cells = np.argwhere(layout.message_mask)
    levels = []
    for bit in (0, 1):
        top, bottom, left, right = layout.cell_box(*cells[bit])
        levels.append(panel[top + 8 : bottom - 8, left + 8 : right - 8].mean())
    assert levels[0] < 0.45 * 255 < 0.55 * 255 <= levels[1]


def test_small_and_gray_frames_are_annotated_large_and_in_colour() -> None:
    layout = make_layout(4, 4, 128, 96, 2)
    frame = np.full((96, 128), 100, np.uint8)
    picture = annotate(Observation.still(frame, frame, layout), decided(layout))
    assert picture.shape == (384, 3 * 512, 3)
    assert np.all(picture[:, :512] == 100)


@pytest.mark.slow
def test_runs_without_a_page_are_compared_and_shown_later(
    evaluated: Path, tmp_path: Path, command: Command
) -> None:
    folder = tmp_path / "run"
    shutil.copytree(evaluated, folder)
    assert not (folder / "report.html").exists()
    assert "0.00" in command(evaluate.main, "--compare", evaluated, folder).stdout
    command(evaluate.main, "--report", folder)
    assert (folder / "report.html").is_file()
