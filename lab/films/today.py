"""What is read by cameras of today from displays of today, and what each effect of them costs.

Each setting is a preset before a camera of some rate. Each pair and view is a cell of the table.
With ``--without`` the same films are taken again with one effect after the other switched off.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from data_gen.effects import FILM_EFFECTS
from data_gen.pairs import GROUPS, pair_names
from lab.films.delivery import deliveries
from lab.films.trial import MAX_LOOPS, Delivery, FilmSettings, check_filmed, check_settings
from lab.study import Results, Study, StudyFlags, Workshop
from link.code.framing import frames_needed
from link.errors import ParameterError, at_least, choose, each_once
from link.presets import PRESETS
from reports.render.tables import Table, number, percent, share_interval
from reports.score.intervals import wilson
from reports.score.reliability import binned_information, merge_bins

SETTINGS = {
    "paper, 30 fps": ("paper", 30.0),
    "robust, 30 fps": ("robust", 30.0),
    "fast, 60 fps": ("fast", 60.0),
    "hidden, 30 fps": ("hidden", 30.0),
    "hidden, 60 fps": ("hidden", 60.0),
    "hidden, 120 fps": ("hidden", 120.0),
}
"""Preset and number of camera frames a second, by the name of the setting."""
WEBCAM_FPS = 30.0
"""Largest number of frames a second that a webcam takes; faster settings leave webcams out."""
NOTHING = "nothing"
"""Name of the films in which no effect is switched off."""
EFFECTS = (*FILM_EFFECTS, "flicker", "ambient", "moire", "jpeg")
"""Effects that can be switched off in turn: those of films, and those that pairs of today change
most."""


@dataclass(frozen=True)
class TodayFlags(StudyFlags):
    """Messages from films by cameras of today of displays of today (simulated)."""

    settings: tuple[str, ...] = tuple(SETTINGS)
    """Names of settings, keys of SETTINGS in lab/films/today.py."""
    pairs: tuple[str, ...] = GROUPS["today"]
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    runs: int = 3
    """Number of runs for each setting, pair and view."""
    without: tuple[str, ...] = (NOTHING,)
    """Effects that are switched off in turn, or "nothing"."""
    n_bytes: int = 100
    """Length of the message, bytes."""
    seconds: float = 5.0
    """Seconds of film after which a run is given up."""

    def film(self, name: str, effect: str) -> FilmSettings:
        """Return how a setting is filmed without an effect."""
        preset_name, fps = choose(SETTINGS, name, "name in --settings")
        preset = PRESETS[preset_name]
        frames = frames_needed(self.n_bytes, preset.layout.n_bits, "n_bytes")
        return FilmSettings(
            kappa=preset.kappa,
            preset=preset_name,
            state_hz=preset.state_hz,
            fps=fps,
            n_bytes=self.n_bytes,
            without=() if effect == NOTHING else (effect,),
            loops=min(MAX_LOOPS, self.seconds * preset.state_hz / 2 / frames),
        )

    def filmed(self, name: str) -> tuple[str, ...]:
        """Return the pairs whose camera takes as many frames a second as the setting asks for."""
        _, fps = SETTINGS[name]
        pairs = pair_names(self.pairs)
        return tuple(pair for pair in pairs if fps <= WEBCAM_FPS or not pair.startswith("webcam"))


@dataclass(frozen=True)
class TodaySeries:
    """Films of one setting, from which one effect is left out."""

    setting: str
    """Name of the setting."""
    without: str
    """Effect that is switched off, or "nothing"."""
    runs: list[Delivery]
    """Every run."""


@dataclass(frozen=True)
class TodayContent:
    """What was measured."""

    series: list[TodaySeries]
    """One entry for each setting and effect."""


def today_blocks(results: Mapping[str, Results[TodayContent]]) -> dict[str, str]:
    """Tabulate the pairs of all settings, and the sum of all pairs without each effect."""
    heads = (
        "delivered", "95 % interval", "seconds, median", "longest", "bits wrong %",
        "information, bits a block and pair",
    )  # fmt: skip
    rows, effects, wrong, wrong_beside = [], [], 0, 0
    for setting in SETTINGS:
        plain = []
        for stored in results.values():
            found = [series for series in stored.content.series if series.setting == setting]
            films = {
                series.without: pd.DataFrame([vars(run) for run in series.runs]) for series in found
            }
            plain += [runs for effect, runs in films.items() if effect == NOTHING]
            if set(films) - {NOTHING}:
                effects += [[setting, effect, *_outcome(runs)] for effect, runs in films.items()]
                wrong_beside += sum(int(runs["wrong"].sum()) for runs in films.values())
        if plain:  # a film that several results hold counts once
            runs = pd.concat(plain).drop_duplicates(["pair", "view_deg", "run"])
            wrong += int(runs["wrong"].sum())
            for pair, filmed in runs.groupby("pair", sort=False):
                rows.append([setting, str(pair), *_outcome(filmed)])
    title = (
        "Simulated hand-held video at 1280 × 720, a 100-byte message; picture, room, pose, clocks "
        "(±1 %) and start in the loop drawn anew in each run, which ends after five seconds; views "
        f"of a pair together. Wrong messages: {wrong} (`python -m lab today`)."
    )
    blocks = {"today": Table(("setting", "pair", *heads), rows, title, left=2).markdown()}
    if effects:
        same = (
            "The same films, with one effect switched off in turn, pairs and views together. "
            f"Wrong messages: {wrong_beside}."
        )
        table = Table(("setting", "switched off", *heads), effects, same, left=2)
        blocks["today_effects"] = table.markdown()
    return blocks


def _outcome(runs: pd.DataFrame) -> list[str]:
    """Write what became of some runs."""
    came, decided = runs[runs["delivered"]], int(runs["bits"].sum())
    bins = merge_bins(runs["bins"])
    return [
        f"{len(came)} of {len(runs)}",
        f"{share_interval(*wilson(len(came), len(runs)), 0)} %",
        number(came["seconds"].median(), 2),
        number(came["seconds"].max(), 2),
        percent(runs["bits_wrong"].sum() / decided) if decided else "–",
        f"{binned_information(bins, decided):.3f}" if decided else "–",
    ]


def check_today(flags: TodayFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(1, runs=flags.runs)
    if not 0 < flags.seconds <= 60:
        raise ParameterError("seconds", f"need more than 0 and at most 60, got {flags.seconds:g}")
    each_once(settings=flags.settings, without=flags.without)
    check_filmed(flags.pairs, flags.views)
    for effect in flags.without:
        choose(dict.fromkeys((NOTHING, *EFFECTS)), effect, "name in --without")
        for name in flags.settings:
            check_settings(flags.film(name, effect))


def measure_today(flags: TodayFlags, workshop: Workshop) -> TodayContent:
    """Film and receive every setting without every effect."""
    found = []
    for name in flags.settings:
        for effect in flags.without:
            film, pairs = flags.film(name, effect), flags.filmed(name)
            runs = deliveries(film, pairs, flags.views, flags.runs, flags.seed, workshop)
            found.append(TodaySeries(name, effect, runs))
    return TodayContent(found)


def label_of_today(flags: TodayFlags) -> str:
    """Name results after their settings, and after what is switched off."""
    words = [name.replace(", ", "_").replace(" fps", "fps") for name in flags.settings]
    return "_".join([*words, *(["effects"] if len(flags.without) > 1 else [])])


STUDY = Study(
    name="today",
    flags=TodayFlags,
    content=TodayContent,
    measure=measure_today,
    blocks=today_blocks,
    page=Path("docs/films.md"),
    check=check_today,
    label=label_of_today,
)
"""The study that `python -m lab today` runs."""
