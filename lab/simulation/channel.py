"""The channel in pictures, and what each of its effects costs each method; about five minutes."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from data_gen.frame_pair import Source
from lab.simulation.channel_pictures import draw_channel
from lab.simulation.sensitivity import effect_conditions, sensitivity_tables
from lab.study import Picture, Results, Study, StudyFlags, Tables, Workshop, blocks_of_tables
from link.errors import at_least
from link.layout import make_layout
from reports.engine.methods import Method, methods_for
from reports.engine.protocols import apply_protocol


@dataclass(frozen=True)
class ChannelFlags(StudyFlags):
    """Pictures and sensitivity of the simulated channel."""

    frames: int = 15
    """Number of frame pairs in each cell of the table of effects."""


def check_channel(flags: ChannelFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    at_least(2, frames=flags.frames)


def measure_effects(flags: ChannelFlags, workshop: Workshop) -> Tables:
    """Decode with every effect switched off in turn."""
    methods = apply_protocol(
        "paper", [Method(n) for n in ("naive", "two_step", "oorc", "hidden_ratex")]
    )
    methods += methods_for(["learned"])
    source = Source(make_layout(), "test", flags.seed)
    records = workshop.predict(effect_conditions(source, flags.frames), methods)
    return Tables({"effects": sensitivity_tables(records)})


def channel_pictures(results: Mapping[str, Results[Tables]]) -> dict[str, Picture]:
    """Draw transfer functions, histograms, one message and all pairs."""
    return draw_channel(Source(make_layout(), "test", results["channel"].meta["seed"]))


STUDY = Study(
    name="channel",
    flags=ChannelFlags,
    content=Tables,
    measure=measure_effects,
    blocks=blocks_of_tables,
    page=Path("docs/channel.md"),
    pictures=channel_pictures,
    check=check_channel,
)
"""The study that `python -m lab channel` runs."""
