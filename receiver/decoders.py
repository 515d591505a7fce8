"""Decoders for a receiver: it may need several, and most films need one, which is then loaded."""

from argparse import ArgumentParser
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any, Protocol

from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder, check_threads, read_model
from link.errors import InputError
from link.frames import SoftBits
from link.layout import Layout
from link.observation import Observation
from link.types import Image
from models import FILM_GRAPH, find_graph, shipped_graphs


class PairDecoder(Protocol):
    """Interface of the decoders that a receiver uses."""

    layout: Layout
    """Layout of the displays that it reads."""

    def prepare(self) -> None:
        """Get ready: frames of this layout will soon come."""
        ...

    def decode(self, original: Image, embedded: Image, /) -> SoftBits:
        """Score the message bits of two rectified frames, an `Image` each."""
        ...


class WindowDecoder(Protocol):
    """The methods that a receiver calls of a decoder of windows of film."""

    def prepare(self) -> None:
        """Get ready: windows will soon come."""
        ...

    def decode(self, observation: Observation) -> SoftBits:
        """Score the message bits of all frame pairs of a window."""
        ...


class Shipped:
    """A decoder whose file is known beforehand, and which is loaded when it is needed.

    Its file is read and checked at once, so that a damaged one is noticed before the film begins.
    Loading takes as long as some camera frames, so it goes on in a thread while these are taken.

    Args:
        path: file that `export.to_onnx` wrote.
        threads: number of threads of onnxruntime.
        load: loads it, which has a method ``decode``; called once.

    Raises:
        InputError: the file is missing, or damaged.
    """

    def __init__(self, path: Path, threads: int, load: Callable[[], Any]) -> None:
        check_threads(threads)
        read_model(path)
        self._load = load
        self._begun: Future[Any] | None = None

    def prepare(self) -> None:
        """Begin to load the file in a thread of its own, unless that has begun already."""
        if self._begun is None:
            worker = ThreadPoolExecutor(1)
            self._begun = worker.submit(self._load)
            worker.shutdown(wait=False)  # it ends with its only task

    def decode(self, *seen: Any) -> SoftBits:
        """Score message bits by what the decoder takes: two frames, or the window of a film.

        Raises:
            InputError: the decoder refuses what it gets, or its file cannot be loaded.
        """
        self.prepare()
        assert self._begun is not None
        scored: SoftBits = self._begun.result().decode(*seen)
        return scored


class ShippedDecoder(Shipped):
    """A decoder of frame pairs that ships, for a layout that is known before it is loaded.

    Args:
        path: file that `export.to_onnx` wrote.
        layout: which the file is for.
        threads: number of threads of onnxruntime.

    Raises:
        InputError: the file is missing, or damaged.
    """

    def __init__(self, path: Path, layout: Layout, threads: int = 2) -> None:
        self.layout = layout

        def load() -> Decoder:
            decoder = Decoder(path, threads, OWN_TIME_LIMIT_S)
            if decoder.layout != layout:
                raise InputError(f"{path}: is for another layout than its name says; export it")
            return decoder

        super().__init__(path, threads, load)


def add_model_flag(parser: ArgumentParser) -> None:
    """Give a command the flag --model, whose value `open_decoders` takes."""
    parser.add_argument(
        "--model",
        type=find_graph,
        action="append",
        help="an .onnx file, or a preset's name, which says what display to look for; may be given "
        "several times; by default those that ship, one for each preset of sender",
    )


def open_decoders(
    models: Sequence[Path] | None, threads: int
) -> tuple[list[PairDecoder], WindowDecoder]:
    """Open the models of --model; where there are none, those that ship, each when it is needed.

    Returns:
        decoders of frame pairs, and the film decoder that ships, which reads films of all layouts
        with pilots that it can read, so that a model names such a layout alone.

    Raises:
        InputError: a file is missing or damaged, or a given one is no decoder.
    """
    film = Shipped(FILM_GRAPH, threads, lambda: FilmGraph(FILM_GRAPH, threads))
    if models:
        return [Decoder(model, threads) for model in models], film
    shipped = shipped_graphs().items()
    return [ShippedDecoder(graph, layout, threads) for layout, graph in shipped], film
