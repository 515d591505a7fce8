"""Train the film decoder on simulated films: python train.py --films.

Films are made on training pictures. A receiver finds, follows and times the display in each, and
hands windows of frames to its film decoder; some of these are kept with the bits that were shown.
Training then moves the constants that all films share (`models.film.decoder`), through the solves
of each window, towards fewer wrong bits. Held-out films tell in the end what it has changed.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from tqdm import tqdm

from data_gen.film.codec import CodecSettings
from data_gen.film.message import FilmSettings, Take
from data_gen.film.phone import PhoneSettings
from data_gen.pairs import PAIRS, get_pair
from export.to_onnx import export_film
from link.captures import KnownWindow, pack_windows, unpack_windows
from link.errors import InputError, ParameterError, at_least, in_range
from link.files.lock import locked
from link.images import write_bytes
from link.outside import is_file
from models.film.decoder import FilmDecoder
from models.film.methods import decode_film_with, load_film_decoder
from models.film.training import Window, film_step
from models.film.window import reads_films
from models.phi.checkpoint import save_checkpoint, training_settings
from models.phi.training import Start, check_rate
from reports.captured.training_set import own_set, windows_of
from reports.engine.backends import Backend, run_tasks
from reports.engine.checked import write_sealed
from reports.engine.records import (
    to_line,
    to_records,
    write_lines,
)
from reports.evaluation.trained import BEFORE, held_out_table, write_page
from reports.films import film_cuts, film_settings
from reports.run import PREDICTIONS, claim_folder

PHONE_CODEC = CodecSettings("h264")
"""Codec of a phone's video, at a rate that is drawn for each film."""
PHONE_KBITS, MOST_REDUCED = (8000.0, 24_000.0), 0.5
"""Least and largest rate of a phone's video in thousands of bits a second, and largest share of the
stored frame before that its noise reduction mixes into a frame."""
UNDECISIVE = ("jobs",)
"""Settings in which two runs of one folder may differ, because they decide no result."""


@dataclass(frozen=True)
class FilmTrainConfig:
    """Train the film decoder on simulated films of one camera-display pair, or of all nine."""

    films: bool = True
    """Train the film decoder; without it, train.py trains the decoder of frame pairs."""
    captures: Path | None = None
    """Train on windows of own films in place of simulated ones: a folder that evaluate.py
    --captures has made of films; a third of them is held out, and measures the result."""
    pair: str = "all"
    """Camera and display, such as canon-lg, or "all"."""
    out: Path | None = None
    """Folder of the run; runs/PAIR-films by default. Films that it holds already are not made
    again; a folder that holds another run is refused."""
    filmed: tuple[str, ...] = (
        "hidden:30",
        "hidden:30:moving",
        "hidden:60",
        "hidden:60:moving",
        "hidden:120",
        "fast:60",
        "fast:60:moving",
        "robust:30:moving",
    )
    """Films to train on, each named PRESET:FPS or PRESET:FPS:CARRIERS."""
    phones: float = 0.5
    """Share of the films that a phone's noise reduction and video codec change."""
    start: Start = "shipped"
    """Initial constants: those of the shipped film decoder, or "constants" as the code has them."""
    number: int = 96
    """Number of training films, dealt out evenly to what is filmed and to the pairs."""
    held_out: int = 24
    """Number of held-out films, of test pictures, by which the result is measured."""
    seconds: float = 1.2
    """Length of each film, seconds; cameras below 60 frames a second film longer."""
    max_view: float = 60.0
    """Largest angle between the camera and the display's normal, degrees."""
    steps: int = 250
    """Number of the optimiser's steps."""
    batch: int = 4
    """Number of windows in a step."""
    lr: float = 0.03
    """Learning rate of Adam at the start; it falls to zero on a cosine."""
    seed: int = 0
    """Seed of every random draw."""
    jobs: int = 2
    """Number of processes that film."""


@dataclass(frozen=True)
class Recording:
    """A film whose windows are kept in a file."""

    take: Take
    """Setting of the film."""
    seconds: float
    """Length of the film, as `film_cuts` takes it."""
    file: Path
    """The file, which is written when all windows are there."""

    def make(self) -> None:
        """Film, receive, and write the windows."""
        write_bytes(self.file, pack_windows(windows_of(film_cuts(self.take, self.seconds))))


def train_films(config: FilmTrainConfig) -> None:
    """Film, train, write checkpoint and graph, and print what held-out films say."""
    check(config)
    usual = f"{'own' if config.captures else config.pair}-films"
    folder, settings = config.out or Path("runs") / usual, training_settings(config)
    with locked(folder):
        claim_folder(folder, settings, "train --films", UNDECISIVE)
        if config.captures is None:
            train, test = (recorded(config, split, folder) for split in ("train", "test"))
        else:
            own = own_set(config.captures, films=True, seed=config.seed)
            train, test = windows_of(own.train), windows_of(own.test)
        module = load_film_decoder() if config.start == "shipped" else FilmDecoder()
        lines = decoded(module, test, BEFORE)
        log = fit_constants(module.train(), [(w.observation, w.bits) for w in train], config)
        write_bytes(folder / "log.jsonl", write_lines(log))
        save_checkpoint(folder, module.eval(), {"train --films": settings})
        parity = export_film(module, folder / "film.onnx")
        lines += decoded(module, test, "film")
        write_sealed(folder / PREDICTIONS, lines)
        table = held_out_table(to_records(lines), "film")
        simulated = config.captures is None
        write_page(folder, to_records(lines), table, settings, config.seed, simulated=simulated)
        print(table)
        print(json.dumps({"out": str(folder), **asdict(parity)}))
        print(f"written: {folder}/report.html")


def check(config: FilmTrainConfig) -> None:
    """Raise an `InputError` that names the first flag whose value is wrong."""
    at_least(1, number=config.number, held_out=config.held_out, steps=config.steps)
    at_least(1, batch=config.batch, jobs=config.jobs)
    in_range(config, phones=(0, 1, ""))
    if config.phones and config.captures is None:
        PHONE_CODEC.check()  # before the first film is made
    check_rate(config.lr)
    for name in config.filmed:
        if not reads_films(film_settings(name).layout):
            raise ParameterError("filmed", f"{name} is read by frame pairs; train without --films")
    if config.pair != "all":
        get_pair(config.pair)


def recorded(config: FilmTrainConfig, split: str, folder: Path) -> list[KnownWindow]:
    """Make the films of a split that are not there yet, and load the windows of all.

    Raises:
        InputError: no film shows its message clearly.
    """
    recordings = deal_out(config, split, folder / split)
    missing = [each for each in recordings if not is_file(each.file)]
    backend = Backend(config.jobs)
    done = len(recordings) - len(missing)
    for outcome in run_tasks(Recording.make, missing, backend, f"{split} films", done):
        if outcome.reason:
            raise InputError(f"a film could not be made: {outcome.reason}")
    windows = [window for each in recordings for window in load_windows(each)]
    if not windows:
        raise InputError("no film shows its message clearly; film more with --seconds, --number")
    return windows


def deal_out(config: FilmTrainConfig, split: str, folder: Path) -> list[Recording]:
    """Deal out films to what is shown and to the pairs; each from an angle of its own."""
    rng = np.random.default_rng([config.seed, split == "test"])
    pairs = tuple(PAIRS) if config.pair == "all" else (get_pair(config.pair).name,)
    recordings = []
    for number in range(config.number if split == "train" else config.held_out):
        settings = film_settings(config.filmed[number % len(config.filmed)])
        if rng.random() < config.phones:
            settings = through_phone(settings, rng)
        view = round(float(rng.uniform(0, config.max_view)), 1)
        take = Take(settings, pairs[number % len(pairs)], view, number, config.seed, split)
        name = f"{number:04d}_{take.name.replace(' ', '_')}.npz"
        recordings.append(Recording(take, config.seconds, folder / name))
    return recordings


def through_phone(settings: FilmSettings, rng: np.random.Generator) -> FilmSettings:
    """Have a phone reduce the noise of a film by what it stored before, and compress it."""
    kbits = float(np.exp(rng.uniform(*np.log(PHONE_KBITS))))
    phone = PhoneSettings(noise_reduction=float(rng.uniform(0, MOST_REDUCED)))
    return replace(settings, phone=phone, codec=replace(PHONE_CODEC, kbits=kbits))


def load_windows(recording: Recording) -> list[KnownWindow]:
    """Load the windows of a film."""
    take = recording.take
    meta: dict[str, object] = {"pair": take.pair, "view_deg": take.view}
    windows = unpack_windows(recording.file, take.settings.layout)
    return [replace(each, kappa=take.settings.kappa, meta=meta) for each in windows]


def fit_constants(
    module: FilmDecoder, windows: list[Window], config: FilmTrainConfig
) -> list[dict[str, float]]:
    """Run the loop.

    Returns:
        the log, an entry a step.

    Raises:
        InputError: the loss is not finite.
    """
    optimiser = torch.optim.Adam(module.parameters(), lr=config.lr)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.steps)
    rng, log = np.random.default_rng(config.seed), []
    for step in tqdm(range(config.steps), desc="train", unit="step"):
        chosen = rng.choice(len(windows), min(config.batch, len(windows)), replace=False)
        try:
            loss = film_step(module, optimiser, [windows[at] for at in chosen])
        except FloatingPointError:
            raise InputError(f"step {step}: the loss is not finite; lower --lr") from None
        schedule.step()
        log.append({"step": step, "loss": round(loss, 5)})
    return log


def decoded(
    module: FilmDecoder, windows: Sequence[KnownWindow], label: str
) -> list[dict[str, Any]]:
    """Decode windows; give a prediction of each, as `reports.engine.records` has them."""
    module.eval()
    return [
        to_line(label, index, decode_film_with(module, window.observation), window)
        for index, window in enumerate(windows)
    ]
