"""Train the map of where displays toggle: python train.py --regions.

Films are drawn over presets, rooms, poses, cameras and codecs: displays with pictures and with
films, within black bars, partly out of view, and some that show no message. They are held still as
the receiver's search does. What the network sees of each film is kept in a file, with the share of
each cell that the display covers. Training then lowers the cross-entropy of all cells. Held-out
films tell in the end how far the outlines of the map are from the displays.
"""

import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, replace
from io import BytesIO
from itertools import islice
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn.functional import binary_cross_entropy_with_logits
from tqdm import tqdm

from data_gen.effects import with_parameter
from data_gen.film.codec import CodecSettings, through_codec
from data_gen.film.frame import VideoFrame
from data_gen.film.message import IN_STEP, plain_states
from data_gen.film.phone import PhoneSettings
from data_gen.film.scenes import SceneSettings
from data_gen.film.stream import States, VideoSettings, film
from data_gen.frame_pair import Source, shuffled_pictures
from data_gen.pairs import GROUPS, pair_names
from data_gen.pictures.carriers import open_carrier
from export.to_onnx import export_region
from link.code.framing import encode
from link.errors import InputError, at_least
from link.files.lock import locked
from link.geometry import in_image, transform
from link.images import as_gray, write_bytes
from link.layout import Layout
from link.loop import LoopStates, MovingStates, loop_of_picture
from link.outside import is_file
from link.presets import PRESETS
from link.types import Corners
from models.phi.checkpoint import save_checkpoint, training_settings
from models.phi.training import check_rate
from models.region import CELL_PX
from models.region.region import DisplayRegion
from receiver.pilots.search.regions import outline_regions
from receiver.pilots.search.watch import Watch
from reports.engine.backends import Backend, run_tasks
from reports.engine.records import write_lines
from reports.render.tables import Table
from reports.run import claim_folder
from reports.score.intervals import wilson

CAMERAS = {
    ("hidden", 30): 0.4,
    ("hidden", 60): 0.15,
    ("hidden", 120): 0.1,
    ("robust", 30): 0.2,
    ("fast", 60): 0.15,
}
"""Share of the films by preset and number of camera frames a second: most of that which is found
latest."""
MOVING, WITH_MESSAGE = 0.45, 0.88
"""Shares of films whose picture moves, and of the others with a message."""
BARS, BAR_SHARE, UPRIGHT = 0.4, (0.3, 0.95), 0.6
"""Share of displays that show the picture within black bars, least and largest share of the display
that the picture then covers, and share of those with bars at the left and the right."""
COVERAGE, LEAVING, OUTSIDE = (0.07, 0.8), 0.35, (0.02, 0.3)
"""Least and largest share of the image that a display covers, drawn by its logarithm; share of
displays that leave the image; and by which share of their width these do."""
DARK, DARK_SHARE = 0.3, (0.1, 0.6)
"""Share of the still pictures that are made darker, and to which least and largest share of their
gray levels."""
GLARE, STRAY, LAMP_LIGHT = 0.25, 0.35, (0.02, 0.5)
"""Shares of films with a bright lamp mirrored in the display, and with one whose light the lens
throws over the image; least and largest light of these lamps where it is brightest, as shares of
frontal white and of what saturates the sensor, drawn by its logarithm."""
MAX_VIEW_DEG = 55.0
"""Largest angle of observation, degrees."""
COUNTS = (8, 12, 23)
"""Numbers of changes from frame to frame that the network learns from; the last only of every third
film, since it takes as long as the others together."""
FILM_PX = (640, 360)
"""Width and height of the films, as the search looks at larger ones."""
CELLS = FILM_PX[1] // CELL_PX, FILM_PX[0] // CELL_PX
"""Rows and columns of the map of a film."""
NOISE_SPREAD, LIGHT_SPREAD, SLOPE_SPREAD = 0.5, 0.2, 0.3
"""Standard deviations by which features are shifted in training, all of a film alike: the
logarithms of powers, the mean level, and the logarithm of the slope. So films of cameras with more
or less noise and light are learned from, too."""


@dataclass(frozen=True)
class RegionTrainConfig:
    """Train the map of where displays toggle, by which the receiver finds them."""

    regions: bool = True
    """Train the map; without it, train.py trains the decoder of frame pairs."""
    out: Path | None = None
    """Folder of the run; runs/regions by default. Films that it holds already are not made again; a
    folder that holds another run is refused."""
    number: int = 1700
    """Number of training films."""
    held_out: int = 100
    """Number of held-out films, of test pictures, by which the result is measured."""
    steps: int = 6000
    """Number of the optimiser's steps."""
    batch: int = 12
    """Number of films in a step."""
    lr: float = 0.004
    """Largest learning rate of AdamW; it rises to that, and falls to zero (one cycle)."""
    seed: int = 2
    """Seed of every random draw."""
    jobs: int = 2
    """Number of processes that film."""


@dataclass(frozen=True)
class RegionFilm:
    """A film of which the network's features are kept in a file."""

    split: str
    """Split of the pictures: "train" or "test"."""
    seed: int
    """Seed of all draws, with the film's number."""
    number: int
    """Number of the film among those of its split."""
    file: Path
    """The file, which is written when everything is there."""

    def make(self) -> None:
        """Film, hold still, and write features and truth."""
        drawn = draw_film(self.split, self.seed, self.number)
        stills, corners = held_still(drawn, max(self.counts) + 1)
        covered = cover(corners) if drawn.shows_message else np.zeros(CELLS, np.float32)
        frames = torch.from_numpy(stills).float()[:, None]
        kept: dict[str, NDArray[Any]] = {"covered": covered, "corners": corners}
        for count in self.counts:
            if count < len(stills):
                features = DisplayRegion.features(frames[: count + 1])[0]
                kept[str(count)] = features.half().numpy()
        packed = BytesIO()
        np.savez(packed, allow_pickle=False, **kept)
        write_bytes(self.file, packed.getvalue())

    @property
    def counts(self) -> tuple[int, ...]:
        """Numbers of changes of which features are kept."""
        return COUNTS if self.number % 3 == 0 else COUNTS[:-1]


@dataclass(frozen=True)
class DrawnFilm:
    """A film that is drawn and not yet taken."""

    frames: Iterator[VideoFrame]
    """Its frames."""
    fps: float
    """Number of camera frames a second."""
    picture: Corners
    """Corners, (4, 2), of the picture with the message in pixels of what the display shows."""
    shows_message: bool
    """Whether the display shows a message."""


def draw_film(split: str, seed: int, number: int) -> DrawnFilm:
    """Draw what a display shows, and how it is filmed."""
    rng = np.random.default_rng([seed, number] if split == "train" else [seed, number, 1])
    name, fps = list(CAMERAS)[rng.choice(len(CAMERAS), p=list(CAMERAS.values()))]
    preset = PRESETS[name]
    source = Source(preset.layout, split, seed)
    pictures = shuffled_pictures(source)
    rgb = pictures[int(rng.integers(len(pictures)))].rgb
    if rng.random() < DARK:
        rgb = np.asarray(rgb * rng.uniform(*DARK_SHARE), np.uint8)
    pairs = pair_names(tuple(GROUPS))
    pair = source.pair(pairs[int(rng.integers(len(pairs)))])
    if rng.random() < GLARE:
        pair = with_parameter(pair, "glare", _by_logarithm(rng, LAMP_LIGHT))
    bits = encode(rng.bytes(100), preset.layout.n_bits)
    loop = loop_of_picture(preset.layout, preset.kappa, bits, rgb, preset.even)
    states: States = LoopStates(loop)
    shows_message = True
    if rng.random() < MOVING:
        carrier = open_carrier("moving", pictures, rng.spawn(1)[0])
        states = MovingStates(loop, carrier, preset.state_hz, bool(rng.random() < IN_STEP))
    elif rng.random() >= WITH_MESSAGE:
        states, shows_message = plain_states(loop, lambda _: rgb, preset.state_hz), False
    layout, picture = preset.layout, preset.layout
    left = top = 0
    if rng.random() < BARS:
        share, black = float(rng.uniform(*BAR_SHARE)), int(rng.integers(0, 6))
        if rng.random() < UPRIGHT:
            layout = replace(picture, width=round(picture.width / share))
        else:
            layout = replace(picture, height=round(picture.height / share))
        left, top = (layout.width - picture.width) // 2, (layout.height - picture.height) // 2
        states = within_bars(states, layout, (left, top), black)
    scene = SceneSettings(
        FILM_PX,
        _by_logarithm(rng, COVERAGE),
        pictures=pictures,
        free=0.0,
        second_display=bool(rng.random() < 0.3),
        outside=_sometimes(rng, LEAVING, OUTSIDE),
        stray=_by_logarithm(rng, LAMP_LIGHT) if rng.random() < STRAY else 0.0,
    )
    phone = PhoneSettings(
        noise_reduction=_sometimes(rng, 0.2, (0, 0.6)),
        sharpen=_sometimes(rng, 0.2, (0, 1.5)),
        local_tone=_sometimes(rng, 0.1, (0.5, 2)),
        stabilise_s=0.3 if rng.random() < 0.15 else 0.0,
    )
    jitter_s = 0.002 if rng.random() < 0.2 else 0.0
    settings = VideoSettings(
        scene, float(fps), preset.state_hz, seconds=2.0, phone=phone, jitter_s=jitter_s
    )
    view = float(rng.uniform(0, MAX_VIEW_DEG))
    frames = film(states, layout, pair, view, settings, rng)
    if rng.random() < 0.25:
        codec = CodecSettings("h264", float(rng.uniform(4000, 16000)))
        frames = through_codec(frames, codec, float(fps))
    corners = picture.corners + np.array([left, top])
    return DrawnFilm(frames, float(fps), corners, shows_message)


def _sometimes(rng: np.random.Generator, share: float, ends: tuple[float, float]) -> float:
    """Draw a number between two ends in a share of all cases, and 0 in the others."""
    return float(rng.uniform(*ends)) if rng.random() < share else 0.0


def _by_logarithm(rng: np.random.Generator, ends: tuple[float, float]) -> float:
    """Draw a number between two ends, each factor being as likely as any other."""
    return float(np.exp(rng.uniform(*np.log(ends))))


def within_bars(states: States, layout: Layout, at: tuple[int, int], black: int) -> States:
    """Show states within black bars.

    Args:
        states: those of the picture.
        layout: of what the display shows, of which only the size counts.
        at: pixels at the left of the picture, and above it.
        black: gray level of the bars.
    """

    def state(number: int) -> NDArray[np.uint8]:
        shown = states(number) if callable(states) else states[number % len(states)]
        right, below = layout.width - at[0] - shown.shape[1], layout.height - at[1] - shown.shape[0]
        bars = at[1], below, at[0], right
        return np.asarray(cv2.copyMakeBorder(shown, *bars, cv2.BORDER_CONSTANT, value=[black] * 3))

    return state


def held_still(drawn: DrawnFilm, count: int) -> tuple[NDArray[np.uint8], Corners]:
    """Hold the first frames still as the receiver's search does.

    Returns:
        (T, H, W) stills, fewer than ``count`` where the camera turns away; and the corners of the
        picture in the first of them.

    Raises:
        InputError: the camera turns away at once.
    """
    first, *others = islice(drawn.frames, count)
    watch = Watch(first.rgb, first.time_s, drawn.fps, picture_moves=False)
    for frame in others:
        if not watch.take(as_gray(frame.rgb), frame.time_s):
            break
    stills = watch.stills.frames
    if len(stills) <= COUNTS[0]:
        raise InputError("the camera turns away at once")
    return stills, transform(first.H_captured_from_display, drawn.picture)


def cover(corners: Corners) -> NDArray[np.float32]:
    """Measure the share of each cell that a quadrilateral covers, (rows, cols) float32."""
    rows, cols = CELLS
    fine, digits = 4, 4  # pixels of a cell along each axis, and binary digits of their parts
    mask = np.zeros((fine * rows, fine * cols), np.uint8)
    points = ((corners + 0.5) * fine / CELL_PX - 0.5) * 2**digits
    cv2.fillConvexPoly(mask, np.int32(np.round(points)), 1, shift=digits)
    share = cv2.resize(mask.astype(np.float32), (cols, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(share, np.float32)


def train_regions(config: RegionTrainConfig) -> None:
    """Film, train, write checkpoint and graph, and print what held-out films say."""
    at_least(1, number=config.number, held_out=config.held_out, steps=config.steps)
    at_least(1, batch=config.batch, jobs=config.jobs)
    check_rate(config.lr)
    folder, settings = config.out or Path("runs") / "regions", training_settings(config)
    with locked(folder):
        claim_folder(folder, settings, "train --regions", ("jobs",))
        train, test = (recorded(config, split, folder) for split in ("train", "test"))
        module, log = fit_map(train, config)
        write_bytes(folder / "log.jsonl", write_lines(log))
        save_checkpoint(folder, module, {"train --regions": settings})
        parity = export_region(module, folder / "region.onnx")
        print(outlines_table(module, test).markdown())
        print(json.dumps({"out": str(folder), **asdict(parity)}))


def recorded(config: RegionTrainConfig, split: str, folder: Path) -> list[Path]:
    """Make the films of a split that are not there yet, and name the files of all that are."""
    number = config.number if split == "train" else config.held_out
    films = [
        RegionFilm(split, config.seed, at, folder / split / f"{at:05d}.npz") for at in range(number)
    ]
    missing = [each for each in films if not is_file(each.file)]
    done = len(films) - len(missing)
    for _ in run_tasks(RegionFilm.make, missing, Backend(config.jobs), f"{split} films", done):
        pass  # of some films the camera turns away at once: they have no file
    files = [each.file for each in films if is_file(each.file)]
    if not files:
        raise InputError(f"no {split} film could be made; film more with --number, --held-out")
    return files


def fit_map(
    files: list[Path], config: RegionTrainConfig
) -> tuple[DisplayRegion, list[dict[str, float]]]:
    """Run the loop; return the module, and the log with an entry a step."""
    features, covered = load_features(files)
    generator = torch.Generator().manual_seed(config.seed)
    torch.manual_seed(config.seed)
    module = DisplayRegion()
    each_pixel = (0, 2, 3)
    module.mean = features.float().mean(each_pixel)[:, None, None]
    module.deviation = features.float().std(each_pixel)[:, None, None]
    optimiser = torch.optim.AdamW(module.parameters(), lr=config.lr, weight_decay=1e-3)
    schedule = torch.optim.lr_scheduler.OneCycleLR(optimiser, config.lr, config.steps)
    log = []
    for step in tqdm(range(config.steps), desc="train", unit="step"):
        chosen = torch.randint(len(features), (config.batch,), generator=generator)
        seen, wanted = features[chosen].float(), covered[chosen]
        for axis in (-1, -2):
            if torch.rand((), generator=generator) < 0.5:
                seen, wanted = seen.flip(axis), wanted.flip(axis)
        noise, light, slope = torch.randn(3, generator=generator).tolist()
        shift = [NOISE_SPREAD * noise] * 4 + [LIGHT_SPREAD * light, SLOPE_SPREAD * slope]
        odds = module.odds(seen + torch.tensor(shift)[:, None, None])
        loss = binary_cross_entropy_with_logits(odds, wanted)
        if not torch.isfinite(loss):
            raise InputError(f"step {step}: the loss is not finite; lower --lr")
        optimiser.zero_grad()
        loss.backward()  # type: ignore[no-untyped-call]
        optimiser.step()
        schedule.step()
        log.append({"step": step, "loss": round(float(loss.detach()), 5)})
    with torch.no_grad():
        for weights in module.parameters():  # the graph keeps float16
            weights.copy_(weights.half())
    return module.eval(), log


def load_features(files: list[Path]) -> tuple[Tensor, Tensor]:
    """Load the features of films, (N, 6, H, W) half precision, and what displays cover, (N, h, w).

    A film is there once for each number of changes.
    """
    features, covered = [], []
    for file in files:
        with np.load(file) as kept:
            for count in kept.files:
                if count.isdigit():
                    features.append(torch.from_numpy(kept[count]))
                    covered.append(torch.from_numpy(kept["covered"]))
    return torch.stack(features), torch.stack(covered)


def outlines_table(module: DisplayRegion, files: list[Path]) -> Table:
    """Show of how many displays the first outline lies within shares of their size from them."""
    within = (0.03, 0.06, 0.1)
    rows = []
    for kind, in_view in {"within the image": True, "partly outside": False}.items():
        offs = []
        for file in files:
            with np.load(file) as kept:
                corners = kept["corners"]
                if not kept["covered"].any() or in_image(corners, FILM_PX[::-1]).all() != in_view:
                    continue
                seen = torch.from_numpy(kept[str(COUNTS[1])])[None].float()
            with torch.no_grad():
                outlines = outline_regions(module.odds(seen)[0].numpy())
            offs.append(min((distance(CELL_PX * o - 0.5, corners) for o in outlines), default=9.0))
        shares = [sum(off <= limit for off in offs) for limit in within]
        ends = [wilson(count, len(offs)) for count in shares]
        found = [
            f"{count} ({low:.0%} – {high:.0%})"
            for count, (low, high) in zip(shares, ends, strict=True)
        ]
        rows.append([kind, str(len(offs)), *found])
    heads = "display", "films", *(f"within {limit:g} of its size" for limit in within)
    text = "Held-out films (simulated) after 12 changes: distance of the worst corner."
    return Table(heads, rows, text)


def distance(outline: Corners, corners: Corners) -> float:
    """Measure the largest distance of corners, as a share of the root of the display's area."""
    size = np.sqrt(cv2.contourArea(corners.astype(np.float32)))
    turned = (np.roll(outline, turn, axis=0) for turn in range(4))
    return float(min(np.linalg.norm(each - corners, axis=1).max() for each in turned) / size)
