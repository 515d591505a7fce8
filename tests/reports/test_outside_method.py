"""A decoder that lives outside of the checkout is compared without an edit of the checkout."""

import csv
import json
import sys
from pathlib import Path

import pytest
from conftest import Command, cases

import evaluate
from link.errors import InputError
from models import Card, find_card, make_decoder
from reports.engine.digest import outside_digest
from reports.engine.methods import Method, methods_for

MODULE = """
from models import Card
from models.paper.naive import Naive

class Mine(Naive):
    card = Card("elsewhere.mine:Mine", "#123456", llr=True)
"""


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder from which Python imports, with the package ``elsewhere``."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "__init__.py").touch()
    (tmp_path / "elsewhere" / "mine.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("elsewhere", "elsewhere.mine"):
        monkeypatch.delitem(sys.modules, name, raising=False)
    return tmp_path


@pytest.mark.slow
def test_a_method_of_another_folder_is_compared(elsewhere: Path, command: Command) -> None:
    flags = ["--pairs", "canon-lg", "--views", "0", "--kappas", "5", "--frames", "1", "--jobs", "1"]
    flags += ["--methods", "elsewhere.mine:Mine", "naive", "--no-html"]
    command(evaluate.main, *flags, "--out", elsewhere / "run")
    rows = json.loads((elsewhere / "run" / "metrics.json").read_text())["rows"]
    assert [row["method"] for row in rows] == ["Mine", "naive"]
    assert rows[0]["correct"] == rows[1]["correct"] > 0
    table = list(csv.DictReader((elsewhere / "run" / "metrics.csv").open()))
    assert [(row["method"], int(row["correct"])) for row in table] == [
        (row["method"], row["correct"]) for row in rows
    ]


def test_its_card_and_its_code_count(elsewhere: Path) -> None:
    assert Method("elsewhere.mine:Mine").card.llr
    assert isinstance(find_card("models.paper.naive:Naive"), Card)
    assert type(make_decoder("elsewhere.mine:Mine", C=2.0)).__name__ == "Mine"
    before = outside_digest("elsewhere.mine")
    (elsewhere / "elsewhere" / "helper.py").write_text("A = 1")
    outside_digest.cache_clear()
    assert before not in ("", outside_digest("elsewhere.mine"))
    assert outside_digest("models.paper.naive") == ""


@cases(
    ("nowhere.mine:Mine", "cannot be imported: No module named 'nowhere'"),
    ("elsewhere.mine:Other", "cannot be imported: module 'elsewhere.mine' has no attribute"),
    (":Mine", "cannot be imported"),
    ("elsewhere.mine:Card", "has no decode"),
    ("mine", "unknown method 'mine'; choose one of: naive"),
)
def test_what_is_no_method_is_refused(name: str, says: str, elsewhere: Path) -> None:
    with pytest.raises(InputError, match=says):
        methods_for([name])


def test_two_methods_of_one_label_are_refused(elsewhere: Path) -> None:
    with pytest.raises(InputError, match="methods: name at least one, and none twice"):
        methods_for(["elsewhere.mine:Mine", "elsewhere.mine:Mine"])


def test_options_stand_behind_the_name() -> None:
    plain, fitted, linear = methods_for(["oorc", "oorc:C=0.1", "linear:degree=4,smooth=false"])
    assert (plain.options, plain.label) == ((), "oorc")
    assert (fitted.name, fitted.options, fitted.label) == ("oorc", (("C", 0.1),), "oorc:C=0.1")
    assert linear.options == (("degree", 4), ("smooth", False))
    fitted.build()
    (fixed,) = methods_for(["naive:threshold=3"])
    assert fixed.options == (("threshold", 3.0),)  # which is None where nobody sets it


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("oorc:D=1", "option of oorc"),
        ("oorc:C=much", "C cannot be 'much'"),
        ("phi:config=1", "config cannot be '1'"),
        ("nothing:C=1", "method"),
    ],
)
def test_wrong_options_are_refused(name: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        methods_for([name])
