"""Train the film decoder on simulated films: python train.py --films.

Films are made on training pictures. A receiver finds, follows and times the display in each, and
hands windows of frames to its film decoder; some of these are kept with the bits that were shown.
Training then moves the constants that all films share (`models.film.decoder`), through the solves
of each window, towards fewer wrong bits. Held-out films tell in the end what it has changed.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from tqdm import tqdm

from data_gen.film.message import Take
from data_gen.pairs import PAIRS, get_pair
from export.to_onnx import export_film
from link.captures import KnownWindow, pack_windows, unpack_windows
from link.errors import InputError, ParameterError, at_least
from link.files.lock import locked
from link.images import write_bytes
from link.markdown import markdown_table
from link.outside import is_file
from models.film.decoder import FilmDecoder
from models.film.methods import decode_film_with, load_film_decoder
from models.film.training import Window, film_step
from models.film.window import reads_films
from models.phi.checkpoint import save_checkpoint, training_settings
from models.phi.training import Start, check_rate
from reports.engine.backends import Backend, one_thread, run_tasks
from reports.engine.records import write_lines
from reports.films import FilmOf, film_settings
from reports.run import claim_folder

UNDECISIVE = ("jobs",)
"""Settings in which two runs of one folder may differ, because they decide no result."""


@dataclass(frozen=True)
class FilmTrainConfig:
    """Train the film decoder on simulated films of one camera-display pair, or of all nine."""

    films: bool = True
    """Train the film decoder; without it, train.py trains the decoder of frame pairs."""
    pair: str = "all"
    """Camera and display, such as canon-lg, or "all"."""
    out: Path | None = None
    """Folder of the run; runs/PAIR-films by default. Films that it holds already are not made
    again; a folder that holds another run is refused."""
    filmed: tuple[str, ...] = ("hidden:30", "hidden:60", "fast:60", "robust:30")
    """What is shown and filmed, PRESET:FPS each."""
    start: Start = "shipped"
    """Initial constants: those of the shipped film decoder, or "constants" as the code has them."""
    number: int = 102
    """Number of training films, dealt out evenly to what is filmed and to the pairs."""
    held_out: int = 12
    """Number of held-out films, of test pictures, by which the result is measured."""
    seconds: float = 1.4
    """Length of each film, seconds."""
    max_view: float = 60.0
    """Largest angle between the camera and the display's normal, degrees."""
    steps: int = 600
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

    film: FilmOf
    """The film."""
    file: Path
    """The file, which is written when all windows are there."""

    def make(self) -> None:
        """Film, receive, and write the windows."""
        one_thread()
        write_bytes(self.file, pack_windows(windows_of(self.film)))


def train_films(config: FilmTrainConfig) -> None:
    """Film, train, write checkpoint and graph, and print what held-out films say."""
    check(config)
    folder = config.out or Path("runs") / f"{config.pair}-films"
    with locked(folder):
        claim_folder(folder, training_settings(config), "train --films", UNDECISIVE)
        train, test = (recorded(config, split, folder) for split in ("train", "test"))
        module = load_film_decoder() if config.start == "shipped" else FilmDecoder()
        before = wrong_bits(module, test)
        log = fit_constants(module.train(), train, config)
        write_bytes(folder / "log.jsonl", write_lines(log))
        save_checkpoint(folder, module.eval(), {"train": training_settings(config)})
        parity = export_film(module, folder / "film.onnx")
        after = wrong_bits(module, test)
        print(result_table(config, before, after, test))
        print(json.dumps({"out": str(folder), **asdict(parity)}))


def check(config: FilmTrainConfig) -> None:
    """Raise an `InputError` that names the first flag whose value is wrong."""
    at_least(1, number=config.number, held_out=config.held_out, steps=config.steps)
    at_least(1, batch=config.batch, jobs=config.jobs)
    check_rate(config.lr)
    for name in config.filmed:
        if not reads_films(film_settings(name).layout):
            raise ParameterError("filmed", f"{name} is read by frame pairs; train without --films")
    if config.pair != "all":
        get_pair(config.pair)


def recorded(config: FilmTrainConfig, split: str, folder: Path) -> list[Window]:
    """Make the films of a split that are not there yet, and load the windows of all.

    Raises:
        InputError: no film shows its message clearly.
    """
    recordings = deal_out(config, split, folder / split)
    missing = [each for each in recordings if not is_file(each.file)]
    backend = Backend(config.jobs)
    done = len(recordings) - len(missing)
    for outcome in run_tasks(Recording.make, missing, backend, f"{split} films", done):
        if outcome.failure is not None:
            raise InputError(f"a film could not be made: {outcome.failure.reason}")
    windows = [window for each in recordings for window in load_windows(each)]
    if not windows:
        raise InputError("no film shows its message clearly; film more with --seconds, --number")
    return windows


def deal_out(config: FilmTrainConfig, split: str, folder: Path) -> list[Recording]:
    """Deal out films to what is shown and to the pairs; each from an angle of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng([config.seed, split == "test"])
    pairs = tuple(PAIRS) if config.pair == "all" else (get_pair(config.pair).name,)
    recordings = []
    for number in range(config.number if split == "train" else config.held_out):
        settings = film_settings(config.filmed[number % len(config.filmed)])
        view = round(float(rng.uniform(0, config.max_view)), 1)
        take = Take(settings, pairs[number % len(pairs)], view, number, config.seed, split)
        seconds = config.seconds * max(1.0, 60 / settings.fps)
        name = f"{number:04d}_{take.name.replace(' ', '_')}.npz"
        recordings.append(Recording(FilmOf(take, seconds), folder / name))
    return recordings


def windows_of(film: FilmOf) -> list[KnownWindow]:
    """Film and receive: the kept windows."""
    return [cut for cut in film.cuts() if isinstance(cut, KnownWindow)]


def load_windows(recording: Recording) -> list[Window]:
    """Load the windows of a film, each with the (P, n_bits) bits that it shows."""
    layout = recording.film.take.settings.layout
    return [(each.observation, each.bits) for each in unpack_windows(recording.file, layout)]


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


def wrong_bits(module: FilmDecoder, windows: list[Window]) -> int:
    """Count the bits of windows that a decoder reads wrongly."""
    module.eval()
    return sum(
        int((decode_film_with(module, window).bits != bits.reshape(-1)).sum())
        for window, bits in windows
    )


def result_table(config: FilmTrainConfig, before: int, after: int, windows: list[Window]) -> str:
    """Tabulate what training changed on the held-out windows."""
    total = sum(bits.size for _, bits in windows)
    rows = [
        [name, f"{100 * wrong / total:.2f}", str(total), str(len(windows))]
        for name, wrong in ((f"{config.start}, before", before), ("trained", after))
    ]
    heads = ["film decoder", "wrong bits %", "bits", "windows"]
    return f"Held-out films (simulated)\n\n{markdown_table(heads, rows)}\n"
