"""Charts have one style, which is theirs alone."""

import ast

import matplotlib
from conftest import ROOT

from reports.render.charts import STYLE, in_style, new_panels

MAKERS = {"Figure", "new_panels"}


def test_other_figures_keep_their_style() -> None:
    before = dict(matplotlib.rcParams)
    assert any(before[name] != value for name, value in STYLE.items())
    new_panels()
    assert dict(matplotlib.rcParams) == before


def test_what_is_drawn_has_the_style() -> None:
    def draw() -> float:
        _, (panel,) = new_panels()
        return float(panel.plot([0, 1], [0, 1])[0].get_linewidth())

    assert (draw(), in_style(draw)()) == (1.5, STYLE["lines.linewidth"])


def test_every_function_that_makes_a_figure_is_in_style() -> None:
    without, count = [], 0
    files = [file for name in ("reports", "lab") for file in (ROOT / name).rglob("*.py")]
    texts = {file: file.read_text() for file in files}
    for file in [file for file, text in texts.items() if "render.charts" in text]:
        for node in ast.walk(ast.parse(texts[file])):
            if isinstance(node, ast.FunctionDef):
                calls = [part for part in ast.walk(node) if isinstance(part, ast.Call)]
                names = {call.func.id for call in calls if isinstance(call.func, ast.Name)}
                if names & MAKERS:
                    count += 1
                    wraps = [each.id for each in node.decorator_list if isinstance(each, ast.Name)]
                    without += [f"{file.name}: {node.name}"] * ("in_style" not in wraps)
    assert without == []
    assert count >= 4
