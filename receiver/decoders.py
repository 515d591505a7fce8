"""Decoders for a receiver: it may need several, and most films need one, which is then loaded."""

from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from export.film_graph import FilmGraph
from export.runtime import OWN_TIME_LIMIT_S, Decoder, check_threads, read_model
from link.errors import InputError
from link.frames import SoftBits
from link.layout import Layout
from link.observation import Observation
from link.types import Image
from models import FILM_GRAPH, shipped_graphs

T = TypeVar("T")


class Loading(Generic[T]):
    """Loads something in a thread of its own when it is first needed, while frames are taken.

    Args:
        load: loads it; called once.
    """

    def __init__(self, load: Callable[[], T]) -> None:
        self._load = load
        self._begun: Future[T] | None = None

    def begin(self) -> Future[T]:
        """Begin to load in a thread, unless that has begun already."""
        if self._begun is None:
            worker = ThreadPoolExecutor(1)
            self._begun = worker.submit(self._load)
            worker.shutdown(wait=False)  # it ends with its only task
        return self._begun


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


class ShippedDecoder:
    """A decoder whose layout is known beforehand, and which is loaded when it is needed.

    Its file is read and checked at once, so that a damaged one is noticed before the film begins.
    Loading takes as long as some camera frames, so it goes on in a thread while these are taken.

    Args:
        path: file that `export.to_onnx` wrote.
        layout: which the file is for.
        threads: number of threads of onnxruntime.

    Raises:
        InputError: the file is missing, or damaged.
    """

    def __init__(self, path: Path, layout: Layout, threads: int = 2) -> None:
        check_threads(threads)
        read_model(path)
        self.layout = layout
        self._path = path
        self._threads = threads
        self._loading = Loading(self._load)

    def prepare(self) -> None:
        """Begin to load the model, beside what else is done."""
        self._loading.begin()

    def _load(self) -> Decoder:
        decoder = Decoder(self._path, self._threads, OWN_TIME_LIMIT_S)
        if decoder.layout != self.layout:
            raise InputError(f"{self._path}: is for another layout than its name says; export it")
        return decoder

    def decode(self, original: Image, embedded: Image, /) -> SoftBits:
        """Score the message bits of two rectified frames, an `Image` each.

        Raises:
            InputError: the file is no decoder for the layout, or the decoder refuses the frames.
        """
        return self._loading.begin().result().decode(original, embedded)


class ShippedFilm:
    """The film decoder that ships, which is loaded when it is needed as `ShippedDecoder` is.

    Args:
        threads: number of threads of onnxruntime.

    Raises:
        InputError: the file is missing, or damaged.
    """

    def __init__(self, threads: int = 2) -> None:
        check_threads(threads)
        read_model(FILM_GRAPH)
        self._loading = Loading(lambda: FilmGraph(FILM_GRAPH, threads))

    def prepare(self) -> None:
        """Begin to load the graph, beside what else is done."""
        self._loading.begin()

    def decode(self, observation: Observation) -> SoftBits:
        """Score the message bits of all frame pairs of a window, in log-likelihood ratios."""
        return self._loading.begin().result().decode(observation)


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
    film = ShippedFilm(threads)
    if models:
        return [Decoder(model, threads) for model in models], film
    shipped = shipped_graphs().items()
    return [ShippedDecoder(graph, layout, threads) for layout, graph in shipped], film
