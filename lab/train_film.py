"""Train the film decoder on simulated films: python -m lab.train_film.

Receivers film messages on training pictures. They hand windows of frames to the decoder with the
constants that are written in the code, and the windows are kept with the bits that were shown.
Training then moves the constants that all films share (`models.film.decoder`), through the solves
of each window, towards fewer wrong bits.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
import tyro
from numpy.typing import NDArray
from torch.nn.functional import binary_cross_entropy_with_logits
from tqdm import tqdm

from data_gen.film.codec import through_codec
from data_gen.pairs import GROUPS, PAIRS
from export.film_graph import FilmWindow
from export.parity import film_tensors
from export.runtime import OWN_TIME_LIMIT_S, Decoder
from export.to_onnx import export_film
from lab.films.rates import SETTINGS
from lab.films.trial import Take, film_message
from lab.study import Workshop
from link.cli import read_flags, run_cli
from link.errors import InputError, ParameterError, at_least
from link.files.lock import locked
from link.images import write_bytes
from link.layout import Layout
from link.outside import is_file, is_no_file
from link.types import Array
from models import FILM_GRAPH
from models.film.decoder import FilmDecoder
from models.phi.checkpoint import save_checkpoint, training_settings
from models.phi.training import check_rate
from receiver.receiver import Receiver
from reports.engine.backends import Backend, one_thread

TRAINED = (
    "hidden", "hidden, 30 fps", "hidden, 60 fps", "faint", "slow camera", "slanted", "fast",
    "robust",
)  # fmt: skip
"""Settings of `lab.films.rates` whose films train the decoder."""
MOST_VIEW = 60.0
"""Largest angle between the camera and the normal of the display, degrees."""
KEPT_WINDOWS = 3
"""Largest number of windows that are kept of a film, the first among them."""
WINDOW_BITS = 0.75
"""Largest share of wrong bits, of those that a window's best match with the loop leaves: half of
all bits are wrong by chance."""


@dataclass(frozen=True)
class TrainFilmConfig:
    """Film, train, export."""

    films: int = 102
    """Number of films, dealt out evenly to settings and camera-display pairs."""
    seconds: float = 1.4
    """Length of each film, seconds."""
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
    out: Path = Path("runs/film")
    """Folder of the windows, of the checkpoint and of the log."""
    graph: Path = FILM_GRAPH
    """The .onnx file that is written; decoder.pt and config.json are written beside it."""


class Recorder:
    """Scores windows by a decoder in torch, and keeps some of them."""

    def __init__(self, module: FilmDecoder) -> None:
        self._module = module
        self.kept: list[tuple[FilmWindow, Array]] = []
        """Windows with their scores (count, rows, cols)."""

    def prepare(self) -> None:
        """Do nothing: the decoder is there."""

    def score(self, window: FilmWindow) -> Array:
        """Give (count, rows, cols) natural log-likelihood ratios of the blocks' bits."""
        with torch.no_grad():
            scores: Array = self._module(*film_tensors(window)).double().numpy()
        self.kept.append((window, scores))
        return scores


def shown_bits(
    scores: Array, layout: Layout, loop: NDArray[np.integer]
) -> NDArray[np.float32] | None:
    """Find the part of a loop that a window shows.

    Args:
        scores: (count, rows, cols) of the window's pairs.
        layout: the layout.
        loop: (loop pairs, n_bits) bits of the loop.

    Returns:
        (count, n_bits) bits of the window's pairs; None where no part of the loop fits clearly.
    """
    decided = scores[:, layout.message_mask] > 0
    numbers = np.arange(len(decided)) + np.arange(len(loop))[:, None]  # (loop pairs, count)
    alike = (decided[:, None] == loop.astype(bool)).mean(2)  # (count, loop pairs)
    fits = alike[np.arange(len(decided)), numbers % len(loop)].mean(1)
    best = int(fits.argmax())
    if 2 * (1 - fits[best]) > WINDOW_BITS:
        return None
    return np.asarray(loop[numbers[best] % len(loop)], np.float32)


@dataclass(frozen=True)
class Recording:
    """A film whose windows are kept."""

    take: Take
    """What is filmed."""
    seconds: float
    """Length of the film."""
    folder: Path
    """Folder of the windows."""


def record(recording: Recording) -> list[str]:
    """Film, receive, and keep some windows with the bits that they show.

    Returns:
        names of the files.
    """
    one_thread()
    take = recording.take
    filmed = film_message(take)
    layout, recorder = take.settings.layout, Recorder(FilmDecoder())
    decoder = Decoder(take.model, 1, OWN_TIME_LIMIT_S)
    receiver = Receiver(decoder, take.settings.fps, recorder)
    for frame in through_codec(filmed.frames, take.settings.codec, take.settings.fps):
        if frame.time_s > recording.seconds:
            break
        receiver.push(frame.rgb, frame.time_s)
    names = []
    chosen = np.linspace(0, max(0, len(recorder.kept) - 1), KEPT_WINDOWS).round().astype(int)
    for at in sorted(set(chosen.tolist()) if recorder.kept else set()):
        window, scores = recorder.kept[at]
        bits = shown_bits(scores, layout, filmed.bits)
        if bits is None:
            continue
        name = f"{take.settings.name(take.seed)}_{take.name.replace(' ', '_')}_{at}.npz"
        save_window(recording.folder / name, window, bits, layout)
        names.append(name)
    return names


def recordings(config: TrainFilmConfig) -> dict[str, Recording]:
    """Deal out films to settings and pairs; each from an angle of its own."""
    folder = config.out / "windows"
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(config.seed)
    chosen = {}
    pairs = (*PAIRS, *GROUPS["today"])
    for number in range(config.films):
        pair = pairs[number % len(pairs)]
        settings = SETTINGS[TRAINED[number % len(TRAINED)]]
        view = round(float(rng.uniform(0, MOST_VIEW)), 1)
        take = Take(settings, pair, view, number, config.seed, split="train")
        chosen[f"{settings.name(config.seed)} {take.name}"] = Recording(
            take, config.seconds * max(1.0, 60 / settings.fps), folder
        )
    return chosen


def save_window(file: Path, window: FilmWindow, bits: NDArray[np.float32], layout: Layout) -> None:
    """Keep a window and the (count, n_bits) bits that it shows; gray levels become float16."""
    arrays: dict[str, Any] = window.inputs | {"frames": window.frames.astype(np.float16)}
    np.savez(file, **arrays, bits=bits, mask=layout.message_mask)


def load_window(file: Path) -> tuple[list[torch.Tensor], torch.Tensor, torch.Tensor]:
    """Load a kept window.

    Returns:
        arguments of `FilmDecoder.forward`, (count, n_bits) bits, and the (rows, cols) mask of the
        message.
    """
    with np.load(file, allow_pickle=False) as stored:
        frames, *others, bits, mask = (torch.from_numpy(stored[name]) for name in stored.files)
    return [frames.float(), *others], bits, mask


def loss_of(module: FilmDecoder, file: Path) -> torch.Tensor:
    """Compute the mean cross-entropy of the bits of a window's inner pairs, in nats."""
    arguments, bits, mask = load_window(file)
    scores = module(*arguments)[:, mask]
    inner = slice(1, -1) if len(bits) > 3 else slice(None)  # pairs at the ends are seen in part
    return binary_cross_entropy_with_logits(scores[inner], bits[inner])


def fit_constants(
    module: FilmDecoder, files: list[Path], config: TrainFilmConfig
) -> list[dict[str, Any]]:
    """Run the loop.

    Returns:
        the log, an entry a step.

    Raises:
        InputError: the loss is not finite.
    """
    optimiser = torch.optim.Adam(module.parameters(), lr=config.lr)
    schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, config.steps)
    rng = np.random.default_rng(config.seed)
    log = []
    for step in tqdm(range(config.steps), desc="train"):
        chosen = rng.choice(len(files), min(config.batch, len(files)), replace=False)
        optimiser.zero_grad()
        total = 0.0
        for at in chosen:
            loss = loss_of(module, files[at]) / len(chosen)
            if not torch.isfinite(loss):
                raise InputError(f"the loss of {files[at]} is not finite; lower --lr")
            loss.backward()  # type: ignore[no-untyped-call]
            total += loss.item()
        torch.nn.utils.clip_grad_norm_(module.parameters(), 1.0)
        optimiser.step()
        schedule.step()
        log.append({"step": step, "loss": round(total, 5)})
    return log


def check_graph(graph: Path) -> None:
    """Raise a `ParameterError` where the graph and its checkpoint would replace something else."""
    if graph.suffix != ".onnx" or is_no_file(graph):
        raise ParameterError("graph", f"need a file that ends in .onnx, got {graph}")
    if is_file(graph.with_name("config.json")) and not is_file(graph):
        said = f"{graph.parent} holds the config.json of something else; name a new folder"
        raise ParameterError("graph", said)


def main() -> None:
    """Film, train, export."""
    config = read_flags(lambda: tyro.cli(TrainFilmConfig))
    at_least(1, films=config.films, steps=config.steps, batch=config.batch, jobs=config.jobs)
    check_rate(config.lr)
    check_graph(config.graph)
    with locked(config.out), locked(config.graph.parent):
        items = recordings(config)
        models = sorted({item.take.model for item in items.values()})
        found = Workshop(config.out, Backend(config.jobs)).each(record, items, models)
        files = [config.out / "windows" / name for names in found.values() for name in names]
        if not files:
            raise InputError("no film shows its message clearly; film more with --seconds, --films")
        module = FilmDecoder()
        log = fit_constants(module, files, config)
        text = "".join(json.dumps(entry) + "\n" for entry in log)
        write_bytes(config.out / "log.jsonl", text.encode())
        save_checkpoint(config.graph.parent, module, {"train": training_settings(config)})
        print(json.dumps(asdict(export_film(module, config.graph))))


if __name__ == "__main__":
    run_cli(main)
