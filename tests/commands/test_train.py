import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from conftest import Command, Refuses, cases

import reports.evaluation.trained as final_evaluation
import train
from data_gen.episodes import EpisodePlan, EpisodeSet, augmented_features, simulate_episodes
from data_gen.frame_pair import Source
from export.parity import Parity
from link.errors import InputError
from link.layout import make_layout
from link.modules import imported_modules
from models import PRETRAINED
from models.phi import checkpoint
from models.phi.checkpoint import load_checkpoint
from models.phi.config import FULL, DecoderConfig
from models.phi.decoder import START_LOG_TEMPERATURE, PhiDecoder
from models.phi.refine import MOMENTS
from models.phi.training import initial_decoder, training_step
from reports.evaluation.trained import FEW
from train import TrainConfig

LAYOUT = make_layout(4, 4, 192, 144, 2)
CONFIG = TrainConfig(episodes=6, rounds=3, steps=3, batch=4, jobs=1, device="cpu")


@pytest.fixture(scope="module")
def episodes() -> EpisodeSet:
    plan = EpisodePlan(CONFIG.episodes, CONFIG.kappas, CONFIG.max_view)
    return simulate_episodes(Source(LAYOUT, "train"), ("canon-lg",), plan, 1)


def trained(episodes: EpisodeSet, folder: Path, config: TrainConfig = CONFIG) -> PhiDecoder:
    module = PhiDecoder(LAYOUT, FULL)
    train.train(module, {LAYOUT: episodes}, config, folder)
    return module


def parameters(module: PhiDecoder) -> dict[str, list[float]]:
    return {name: value.flatten().tolist() for name, value in module.state_dict().items()}


def read_log(folder: Path) -> list[dict[str, float]]:
    return [json.loads(line) for line in (folder / "log.jsonl").read_text().splitlines()]


# The command


@pytest.mark.exhaustive  # the export takes minutes; the next test trains without it
def test_train_writes_a_run(run_folder: Path) -> None:
    names = {file.name for file in run_folder.iterdir() if file.is_file()}
    assert names >= {"decoder.pt", "config.json", "decoder.onnx", "metrics.json", "log.jsonl"}
    log = read_log(run_folder)
    assert [entry["step"] for entry in log] == list(range(6))
    assert all(0 <= entry["bit_error"] <= 0.5 for entry in log)
    after, before = parameters(load_checkpoint(run_folder)), parameters(load_checkpoint(PRETRAINED))
    assert list(after) == list(before)
    for name, values in after.items():
        moved = np.abs(np.subtract(values, before[name]))
        assert 0 < moved.max() <= 6 * 0.1, name  # six steps of at most the learning rate each


@pytest.mark.slow
def test_training_again_into_the_same_folder_evaluates_the_new_decoder(
    tmp_path: Path, command: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the export, which takes long."""
    monkeypatch.setattr(final_evaluation, "export", lambda *_: Parity(1, 59, 0, 0.0, 1.0, 0.5))
    monkeypatch.setattr(final_evaluation, "OF_PAIRS", FEW)
    small = ["--episodes", "2", "--rounds", "1", "--steps", "1", "--batch", "2", "--jobs", "1"]
    small += ["--frames", "1", "--out", str(tmp_path)]
    command(train.main, *small)
    decoder, metrics = ((tmp_path / name).read_bytes() for name in ("decoder.pt", "metrics.json"))
    config = json.loads((tmp_path / "config.json").read_text())
    assert (config["train"]["episodes"], config["train"]["batch"]) == (2, 2)
    assert load_checkpoint(tmp_path).layout == make_layout()
    rows, methods = json.loads(metrics)["rows"], {*FEW, "before"}  # before it was trained
    cells = product(methods, (3, 5), (0.0, 45.0))
    assert sorted((row["method"], row["kappa"], row["view_deg"]) for row in rows) == sorted(cells)
    assert np.isfinite([entry["loss"] for entry in read_log(tmp_path)]).all()

    def marks() -> set[str]:
        lines = (tmp_path / "predictions.jsonl").read_text().splitlines()
        return {json.loads(line)["mark"] for line in lines}

    stored = marks()
    assert len(stored) == len(methods)
    train_loop = train.train

    def train_otherwise(module: PhiDecoder, *rest: Any) -> None:
        train_loop(module, *rest)
        with torch.no_grad():
            next(module.parameters()).mul_(1.1)

    monkeypatch.setattr(train, "train", train_otherwise)
    command(train.main, *small)
    assert (tmp_path / "decoder.pt").read_bytes() != decoder
    (anew,) = marks() - stored  # that of the learned decoder
    assert (tmp_path / "predictions.jsonl").read_text().count(anew) == 4


@cases(
    ("--kappas 0 65", "--kappas: "),
    ("--kappas", "--kappas: name at least one"),
    ("--max-view -1", "--max-view: need at least 0 degrees, got -1"),
    ("--max-view 400", "--max-view: need an angle within"),
    ("--lr 0", "--lr: need more than 0 and less than 10, got 0"),
    ("--lr nan", "--lr: need a finite number, got nan"),
    ("--batch 0", "--batch: need at least 1, got 0"),
    ("--decoder.refine 2", "--start: the shipped decoder has other parts; choose constants"),
)
def test_each_wrong_flag_has_a_message_of_its_own(
    flags: str, message: str, refuses: Refuses
) -> None:
    refuses("train", f"--out run {flags}", f"error: {message}")


@cases(
    ("--decoder.degree 40", "decoder: degree: need 1 to 12, got 40"),
    ("--decoder.coarsen 3", "decoder: coarsen: need 1 or 2, got 3"),
    ("--decoder.channels hsv", "decoder: unknown channels 'hsv'"),
)
def test_a_wrong_part_of_the_decoder_is_named(flags: str, message: str, command: Command) -> None:
    said = command(train.main, *flags.split(), status=2).stderr
    assert message in said and "Traceback" not in said


# The loop


def test_training_starts_from_the_shipped_parameters_or_from_constants() -> None:
    shipped = load_checkpoint(PRETRAINED, LAYOUT)
    assert parameters(initial_decoder(LAYOUT, FULL, "shipped")) == parameters(shipped)
    constants = PhiDecoder(LAYOUT, FULL)
    assert parameters(initial_decoder(LAYOUT, FULL, "constants")) == parameters(constants)
    plain = initial_decoder(LAYOUT, DecoderConfig(), "constants")
    assert plain.log_temperature.item() == START_LOG_TEMPERATURE


def test_a_step_without_a_finite_loss_changes_nothing(episodes: EpisodeSet) -> None:
    module = PhiDecoder(LAYOUT, FULL)
    before = parameters(module)
    optimiser = torch.optim.Adam(module.parameters(), lr=0.1)
    with torch.no_grad():
        ratex, blocks = module.summarise(episodes.original, episodes.embedded)
    with pytest.raises(FloatingPointError):
        training_step(module, optimiser, ratex, blocks * torch.nan, episodes.bits)
    assert parameters(module) == before


@pytest.mark.slow
def test_the_same_seed_trains_the_same_parameters(episodes: EpisodeSet, tmp_path: Path) -> None:
    torch.manual_seed(1)
    one = trained(episodes, tmp_path / "one")
    torch.manual_seed(2)  # must not matter
    two = trained(episodes, tmp_path / "two")
    other = trained(episodes, tmp_path / "other", replace(CONFIG, seed=1))
    assert parameters(one) == parameters(two)
    assert parameters(one) != parameters(other)
    assert read_log(tmp_path / "one") == read_log(tmp_path / "two")


def test_a_killed_run_goes_on_to_the_same_parameters(
    episodes: EpisodeSet, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = trained(episodes, tmp_path / "whole")
    save = train.save_state

    def save_and_die(*arguments: object) -> None:
        save(*arguments)  # type: ignore[arg-type]
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(train, "save_state", save_and_die)
        with pytest.raises(KeyboardInterrupt):
            trained(episodes, tmp_path / "cut")
    assert (tmp_path / "cut" / "state.pt").is_file()

    rounds: list[int] = []

    def count(*arguments: Any) -> tuple[torch.Tensor, torch.Tensor]:
        rounds.append(1)
        return augmented_features(*arguments)

    monkeypatch.setattr(train, "augmented_features", count)
    resumed = trained(episodes, tmp_path / "cut")
    assert len(rounds) == CONFIG.rounds - 1  # the first round was not repeated
    assert parameters(resumed) == parameters(whole)
    assert read_log(tmp_path / "cut") == read_log(tmp_path / "whole")


@pytest.mark.parametrize("kind", ["damaged", "large"])
def test_a_state_that_is_no_state_is_refused_in_one_line(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = tmp_path / "state.pt"
    with file.open("wb") as opened:
        opened.truncate(101 if kind == "large" else 100)
    monkeypatch.setattr(checkpoint, "MAX_STATE_BYTES", 100)
    says = {"damaged": "damaged; delete it", "large": "larger than 100 bytes; no such"}[kind]
    with pytest.raises(InputError, match=rf"state\.pt: {says}") as error:
        checkpoint.resume_state(file, {}, torch.Generator(), "key")
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_state_of_other_settings_is_not_continued(episodes: EpisodeSet, tmp_path: Path) -> None:
    other = replace(CONFIG, lr=0.01)
    trained(episodes, tmp_path / "used", other)
    anew = trained(episodes, tmp_path / "used")
    assert parameters(anew) == parameters(trained(episodes, tmp_path / "fresh"))


MATTER = {"lr": 0.02, "batch": 5, "seed": 1, "kappas": (2,)}
OF_EVALUATION = {"out": Path("elsewhere"), "frames": 2, "jobs": 2}


@cases(*MATTER.items(), *OF_EVALUATION.items())
def test_settings_that_matter_are_part_of_the_key(name: str, value: Any) -> None:
    changed = train.resume_key(replace(CONFIG, **{name: value}))
    assert (changed != train.resume_key(CONFIG)) == (name in MATTER)


def test_a_half_finished_training_depends_on_the_code_that_it_runs_alone() -> None:
    modules = set(imported_modules(train.TRAINED_BY))
    assert {"data_gen.augment", "data_gen.frame_pair", "link.embed"} <= modules
    assert {"models.phi.solver", "models.phi.refine", "models.phi.register"} <= modules
    assert not {name for name in modules if name.startswith(("export.", "reports."))}


def test_a_finished_run_is_not_trained_further(episodes: EpisodeSet, tmp_path: Path) -> None:
    once = trained(episodes, tmp_path)
    log = read_log(tmp_path)
    assert parameters(trained(episodes, tmp_path)) == parameters(once)
    assert read_log(tmp_path) == log


def test_a_loss_that_is_not_finite_stops_training(episodes: EpisodeSet, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the loss is not finite; lower --lr"):
        trained(episodes, tmp_path, replace(CONFIG, lr=1e30))
    assert not (tmp_path / "decoder.pt").exists()


def test_every_round_augments_anew(episodes: EpisodeSet) -> None:
    module = PhiDecoder(LAYOUT, FULL)
    generator = torch.Generator().manual_seed(0)
    first, second = (
        augmented_features(episodes, module.summarise, "cpu", generator) for _ in range(2)
    )
    features = FULL.degree + MOMENTS
    assert first[0].shape == (CONFIG.episodes, 16 * len(LAYOUT.ratex), features)
    assert first[1].shape == (CONFIG.episodes, LAYOUT.n_bits, features)
    assert not torch.equal(first[0], second[0])
    assert not first[0].requires_grad
