"""How other systems do on the same captures: bit accuracy against visibility.

Packages, without their dependencies: `adapters.INSTALL` is the command that installs them.
"""

from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from data_gen.channel.optics import check_view
from data_gen.frame_pair import Source
from lab.comparison.peers.adapters import PEERS, make_peers
from lab.comparison.peers.page import (
    PACKAGES,
    PeersContent,
    count_readings,
    peers_blocks,
    peers_pictures,
)
from lab.comparison.peers.systems import (
    PairSystem,
    PeerTask,
    Reading,
    StillSystem,
    System,
    read_messages,
)
from lab.study import Study, StudyFlags, Workshop
from link.embed import check_kappa
from link.errors import InputError, ParameterError, at_least, choose, each_once
from link.layout import make_layout
from models import DECODERS, PRETRAINED
from reports.engine.methods import methods_for

MAX_BITS = 1024
"""Largest number of message bits; the pictures have three times as many blocks of 8 x 8."""


@dataclass(frozen=True)
class PeersFlags(StudyFlags):
    """Bit accuracy against visibility: other systems, and ours."""

    pairs: tuple[str, ...] = ("canon-lg", "nikon-samsung", "sony-imac")
    """Camera-display pairs."""
    views: tuple[float, ...] = (0.0, 45.0)
    """Angles between the camera and the normal of the display, degrees."""
    systems: tuple[str, ...] = tuple(PEERS)
    """Other systems."""
    ours: tuple[str, ...] = ("learned", "oorc", "blind")
    """Methods of this repository."""
    kappas: tuple[int, ...] = (1, 2, 3, 5, 10)
    """Strengths of ours: gray levels added to a block that carries a 1."""
    frames: int = 6
    """Number of pictures."""
    bits: int = 32
    """Number of message bits of the other systems; rivaGAN has 32."""


def check_peers(flags: PeersFlags) -> None:
    """Raise an `InputError` for the first wrong flag, or where a package is missing."""
    for pair in flags.pairs:
        source_of(flags).pair(pair)
    for view in flags.views:
        check_view(view, "views")
    for kappa in flags.kappas:
        check_kappa(kappa, "kappas")
    for name in flags.ours:
        choose(DECODERS, name, "method")
    at_least(1, frames=flags.frames, bits=flags.bits)
    each_once(pairs=flags.pairs, views=flags.views, kappas=flags.kappas)
    if flags.bits > MAX_BITS:
        raise ParameterError("bits", f"need at most {MAX_BITS}, got {flags.bits}")
    make_systems(flags)


def source_of(flags: PeersFlags) -> Source:
    """Pictures and channel, in which the corners of the display are known exactly."""
    return Source(make_layout(), "test", flags.seed, parameters=(("corner_px", 0.0),))


def measure_peers(flags: PeersFlags, workshop: Workshop) -> PeersContent:
    """Let each system embed and read."""
    versions = peer_versions()
    tasks = {
        f"{system.name}, {system.strength}": PeerTask(
            source_of(flags), flags.pairs, flags.views, flags.frames, system, versions
        )
        for system in make_systems(flags)
    }
    found = workshop.each(read_messages, tasks, [PRETRAINED / "decoder.pt"])
    readings = [Reading(**reading) for each in found.values() for reading in each]
    return PeersContent(count_readings(readings), versions)


def make_systems(flags: PeersFlags) -> list[System]:
    """Make the systems at their strengths.

    Raises:
        InputError: a package is missing, or no system is named.
    """
    stills: list[System] = [
        StillSystem(peer) for name in flags.systems for peer in make_peers(name, flags.bits)
    ]
    ours: list[System] = [
        PairSystem(method, kappa) for method in methods_for(flags.ours) for kappa in flags.kappas
    ]
    if not stills and not ours:
        raise InputError("--systems, --ours: name at least one")
    return [*ours, *stills]


def peer_versions() -> dict[str, str]:
    """Versions of those packages of the other systems that are installed."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


STUDY = Study(
    name="peers",
    flags=PeersFlags,
    content=PeersContent,
    measure=measure_peers,
    blocks=peers_blocks,
    page=Path("docs/peers.md"),
    pictures=peers_pictures,
    check=check_peers,
)
"""The study that `python -m lab peers` runs."""
