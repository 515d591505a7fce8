"""The benchmark, and the plain network that enters it."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import Command

import evaluate
from data_gen.frame_pair import Source
from examples import lightnet
from link.layout import make_layout
from link.presets import PRESETS
from reports import benchmark, films
from reports.benchmark import benchmark_conditions
from reports.engine.methods import Method
from reports.engine.predict import Condition, paper_cells
from reports.evaluation.comparison import film_conditions


@pytest.mark.exhaustive
def test_a_decoder_of_ones_own_is_trained_and_enters_the_benchmark(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    stills = Source(make_layout(), seed=0)
    small = [
        Condition("stills", stills, paper_cells(["canon-lg"], (0.0,), (5,)), 1),
        *film_conditions(["robust:30"], ["phone-oled"], [0.0], 1, 0),
    ]
    assert [each.name for each in small] == ["stills", "robust:30"]
    assert {each.name for each in small} < {each.name for each in benchmark_conditions()}
    monkeypatch.setattr(benchmark, "benchmark_conditions", lambda: small)
    monkeypatch.setattr(lightnet, "SHOWN", ("paper",))
    monkeypatch.chdir(tmp_path)
    lightnet.train(lightnet.Training(episodes=2, steps=2, jobs=1))
    run = ["--benchmark", "--methods", "examples.lightnet:LightNet", "oorc", "--jobs", "1"]
    command(evaluate.main, *run, "--no-html", "--out", tmp_path / "run")
    result = json.loads((tmp_path / "run" / "benchmark.json").read_text())
    assert (result["benchmark"], result["failed_cells"]) == (benchmark.VERSION, [])
    assert all(len(each["frames"]) == 16 for each in result["conditions"].values())
    plain, oorc = result["decoders"]
    assert (plain["class"], oorc["decoder"]) == ("examples.lightnet:LightNet", "oorc")
    assert list(plain["wrong"]) == ["stills", "robust:30"]
    assert plain["checkpoint"]
    assert oorc["wrong"]["stills"]["share"] < 0.1
    command(evaluate.main, *run, "--no-html", "--out", tmp_path / "run")
    assert json.loads((tmp_path / "run" / "benchmark.json").read_text()) == result


def test_all_decoders_of_the_benchmark_see_the_same_captures() -> None:
    methods = [Method(name) for name in ("hidden_ratex", "blind", "learned")]
    for condition in benchmark_conditions():
        assert not any(condition.equalises(method) for method in methods)


def test_pictures_are_equalised_in_place_of_ratex_patches_alone() -> None:
    for layout, equalised in ((make_layout(), True), (PRESETS["hidden"].layout, False)):
        condition = Condition("", Source(layout), paper_cells(["canon-lg"]), 1)
        assert condition.equalises(Method("blind")) == equalised
        assert not condition.equalises(Method("learned"))


@pytest.mark.slow
def test_films_of_patches_say_what_the_patches_displayed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(films, "SECONDS", 0.8)
    (condition,) = film_conditions(["paper:30"], ["canon-lg"], [0.0], 1, 0)
    captured = condition.source.observe(condition.cells[0], 0, False)
    assert captured.kappa == PRESETS["paper"].kappa
    scores = Method("two_step").build().decode(captured.rectified()).scores
    assert np.mean((scores > 0) == captured.bits) > 0.9


def test_the_benchmark_has_conditions_of_its_own(command: Command, tmp_path: Path) -> None:
    done = command(evaluate.main, "--benchmark", "--frames", 3, "--out", tmp_path, status=2)
    assert "--benchmark: has conditions of its own; leave out --frames" in done.stderr
