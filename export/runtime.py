"""Decode frame pairs with numpy, OpenCV and onnxruntime alone.

python -m export.runtime MODEL ORIGINAL EMBEDDED [--corners x,y x,y x,y x,y]
"""

import json
import re
import sys
from argparse import ArgumentTypeError
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import ArrayLike, NDArray
from onnxruntime.capi import onnxruntime_pybind11_state as ort_errors

from export.onnx_file import check_onnx_file
from export.watchdog import Watchdog
from link.cli import Parser, add_pixel_limit, check_flags, run_cli
from link.errors import InputError, ParameterError
from link.frames import Captured, SoftBits, check_same_size
from link.geometry import as_corners
from link.images import as_batch
from link.layout import MIN_BLOCK_PX, Layout
from link.observation import Observation
from link.outside import is_file, parse_json, read_bounded
from link.pilots import pilots_toggled
from link.ratex import patch_correlation
from link.types import Image
from models import find_graph

ORT_ERRORS: tuple[type[Exception], ...] = (
    *(
        error
        for error in vars(ort_errors).values()
        if isinstance(error, type) and issubclass(error, Exception)
    ),
    IndexError,
    MemoryError,
    RuntimeError,
    ValueError,
)
"""Exceptions that onnxruntime raises on a damaged or foreign model: its own, and those that its
Python binding makes of C++ exceptions."""
MAX_MODEL_BYTES = 64 * 2**20
"""Largest size, in bytes, of a model file that is read; the shipped decoder has 0.15 million."""
MAX_MEMORY_BYTES = 1536 * 2**20
"""Largest memory, in bytes, that the models of a process may take for their tensors. Frames take
about 50 bytes a pixel."""
MAX_THREADS = 256
"""Largest number of threads of onnxruntime."""
TIME_LIMIT_S = 7.0
"""Seconds that loading a model may take, and a run on frames of few pixels."""
OWN_TIME_LIMIT_S = 120.0
"""Seconds that loading and running may take where the model is known to end: one that ships with
the project, or that a study exported. Other work on the machine may slow it down."""
TIME_LIMIT_S_PER_MEGAPIXEL = 1.0
"""Seconds that a run may take longer for each million pixels of its frames."""
NO_KERNEL = "MatmulTransposeFusion"
"""A step of optimization that onnxruntime leaves out: before version 1.26 it makes products of
float64 for which there is no kernel, and later versions use it for no product of the decoders."""
NOWHERE = "/dev/null/nowhere"
"""A folder that cannot exist, where onnxruntime may look for files that a model names."""
DECODED_CORRELATION = 0.8
"""Smallest `link.ratex.patch_correlation` of frames that the command decodes; simulated captures up
to 70 degrees have 0.97 and more."""
LEAST_TOGGLED = 2.5
"""Smallest `link.pilots.pilots_toggled` of frames that the command decodes. Of
216 simulated pairs up to 60 degrees, those below had a fifth of their bits wrong or more; of as
many that were turned round, so that no pilot is where it should be, some 3 % are above."""
FORMAT = "1"
"""Version of the metadata, and of the graph's inputs and outputs, that this code reads."""


WATCHDOG = Watchdog()
"""Stops every model of this process that takes too long."""


class Decoder:
    """A decoder in an ONNX file, which carries its own layout.

    The file may come from a stranger: it is checked before it runs, its memory is bounded
    (`MAX_MEMORY_BYTES`), and a run that takes too long is stopped. `export.watchdog` tells what
    happens to a run that does not let itself be stopped.

    Args:
        path: file that `export.to_onnx` wrote.
        threads: number of threads of onnxruntime.
        time_limit_s: seconds that loading and a run on small frames may take; a run may take
            `TIME_LIMIT_S_PER_MEGAPIXEL` longer for each million pixels.

    Raises:
        InputError: the file is missing, damaged, or no decoder of this version.

    >>> from link.embed import embed
    >>> from models import PRETRAINED
    >>> decoder = Decoder(PRETRAINED / "decoder.onnx")
    >>> layout = decoder.layout
    >>> gray = np.full((layout.height, layout.width, 3), 128, np.uint8)
    >>> bits = np.arange(layout.n_bits) % 2
    >>> shown = embed(gray, bits, layout, kappa=5)
    >>> bool((decoder.decode(shown.original, shown.embedded).bits == bits).all())
    True
    """

    def __init__(
        self, path: Path | str, threads: int = 2, time_limit_s: float = TIME_LIMIT_S
    ) -> None:
        path = Path(path)
        self._time_limit_s = time_limit_s
        self._session, self.metadata = load_session(path, threads, time_limit_s)
        self.layout: Layout
        """Grid of the message bits that the model decodes."""
        self.features: list[str]
        """Names of the weights of the fitted head, less the bias."""
        self.layout, self.features = self._checked(path)

    def _checked(self, path: Path) -> tuple[Layout, list[str]]:
        """The layout and the features' names, once the graph is known to fit them."""
        inputs, outputs = self._session.get_inputs(), self._session.get_outputs()
        names = [[node.name for node in nodes] for nodes in (inputs, outputs)]
        if self.metadata.get("format") != FORMAT or names != [
            ["original", "embedded"],
            ["scores", "head"],
        ]:
            raise InputError(f"{path}: not a decoder of this version; export it again")
        try:
            layout = Layout.from_dict(parse_json(self.metadata.get("layout", "null"), "layout"))
        except InputError as error:
            raise InputError(f"{path}: carries no layout; export it again ({error})") from None
        features = parse_json(self.metadata.get("features", "null"), f"{path}, features")
        if not isinstance(features, list) or not all(isinstance(name, str) for name in features):
            raise InputError(f"{path}: its features are no list of names; export it again")
        needs = ("scores", layout.n_bits), ("weights", len(features) + 1)
        for (what, needed), node in zip(needs, outputs, strict=True):
            *_, width = node.shape or [None]
            if isinstance(width, int) and width != needed:
                raise InputError(
                    f"{path}: gives {width} {what} where its metadata says {needed}; export it "
                    "again"
                )
        return layout, features

    def prepare(self) -> None:
        """Do nothing: the model was loaded when the decoder was made."""

    def decode(
        self,
        original: Image,
        embedded: Image,
        corners: ArrayLike | None = None,
        corners_embedded: ArrayLike | None = None,
    ) -> SoftBits:
        """Decode one frame pair.

        Args:
            original: an `Image`. Without ``corners`` the frame is
                already rectified: the displayed picture fills it, at any size.
            embedded: an `Image` of the shape of ``original``.
            corners: (4, 2) pixels of the displayed picture in the captured original: top-left,
                top-right, bottom-right, bottom-left (see `link.geometry`).
            corners_embedded: (4, 2) pixels of the displayed picture in the captured embedded
                frame; ``corners`` where absent.

        Returns:
            scores of the message bits in row-major order, positive for 1, and the fitted head.

        Raises:
            InputError: frames of wrong type, size or shape, or corners that do not fit.
        """
        pair = self.rectify(original, embedded, corners, corners_embedded)
        scores, head = self.run(as_batch(pair.original), as_batch(pair.embedded))
        return SoftBits(scores[0].astype(np.float64), head[0].astype(np.float64))

    def run(
        self, original: NDArray[np.uint8], embedded: Image
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Run the graph on a batch of rectified frame pairs.

        Args:
            original: (B, 3, H, W) uint8, encoded RGB.
            embedded: (B, 3, H, W) uint8, encoded RGB.

        Returns:
            scores (B, n_bits) float32, and the fitted heads (B, features) float32.

        Raises:
            InputError: onnxruntime failed, took too long, or returned something else.
        """
        count = len(original)
        megapixels = count * original.shape[2] * original.shape[3] / 1e6
        limit = self._time_limit_s + TIME_LIMIT_S_PER_MEGAPIXEL * megapixels
        frames = {"original": original, "embedded": np.asarray(embedded)}
        scores, head = run_session(self._session, ["scores", "head"], frames, limit)
        for values, width in ((scores, self.layout.n_bits), (head, len(self.features) + 1)):
            if (
                not isinstance(values, np.ndarray)
                or values.dtype != np.float32
                or values.shape != (count, width)
                or not np.isfinite(values).all()
            ):
                raise InputError("the model returned no valid scores; export it again")
        return scores, head

    def rectify(
        self,
        original: Image,
        embedded: Image,
        corners: ArrayLike | None = None,
        corners_embedded: ArrayLike | None = None,
    ) -> Observation:
        """Resample frames to the displayed picture, or check that they are rectified already.

        Args:
            original: an `Image`.
            embedded: an `Image` of the shape of ``original``.
            corners: (4, 2) pixels of the displayed picture in the original frame; None where the
                picture fills the frames.
            corners_embedded: (4, 2) pixels in the embedded frame; ``corners`` where absent.

        Raises:
            InputError: frames of wrong type, size or shape, or corners that do not fit.
        """
        frames = [np.asarray(frame) for frame in (original, embedded)]
        for frame in frames:
            if (
                frame.dtype != np.uint8
                or frame.ndim not in (2, 3)
                or frame.shape[2:] not in ((), (3,))
            ):
                raise InputError(
                    f"frames must be uint8 (H, W) or (H, W, 3), got {frame.dtype} {frame.shape}"
                )
        layout = self.layout
        if corners is None and corners_embedded is not None:
            raise ParameterError(
                "corners_embedded", "is given without corners; give those of both frames"
            )
        if corners is not None:
            found = as_corners(corners)
            other = found if corners_embedded is None else as_corners(corners_embedded)
            return Captured(frames[0], frames[1], layout, found, other).rectified()
        check_same_size(frames[0], frames[1])
        height, width = frames[0].shape[:2]
        if height < layout.rows * MIN_BLOCK_PX or width < layout.cols * MIN_BLOCK_PX:
            raise InputError(
                f"a {width}x{height} frame is too small for {layout.cols}x{layout.rows} blocks"
            )
        return Observation.still(frames[0], frames[1], layout)


def read_model(path: Path) -> bytes:
    """Read the bytes of an .onnx file and check them as `export.onnx_file` does.

    Raises:
        InputError: the file is missing, too large, damaged, or holds what no decoder needs.
    """
    if not is_file(path):
        raise InputError(f"{path}: no such model; export one with python -m export.to_onnx RUN")
    data = read_bounded(path, MAX_MODEL_BYTES)
    try:
        check_onnx_file(data)
    except InputError as error:
        raise _unreadable(path, error) from None
    return data


def load_session(
    path: Path, threads: int, time_limit_s: float
) -> tuple[onnxruntime.InferenceSession, dict[str, str]]:
    """Load a model that may come from a stranger, with bounds to its memory and time.

    It reads no other file.

    Args:
        path: the .onnx file.
        threads: number of threads of onnxruntime.
        time_limit_s: seconds that loading may take.

    Returns:
        the session, and the model's metadata.

    Raises:
        InputError: the file is missing, damaged, takes too long, or holds what no decoder needs.
    """
    check_threads(threads)
    data = read_model(path)
    _bound_memory()
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.log_severity_level = 4
    options.add_session_config_entry("session.load_model_format", "ONNX")
    options.add_session_config_entry("session.use_env_allocators", "1")
    options.add_session_config_entry(
        "session.model_external_initializers_file_folder_path", NOWHERE
    )
    overdue = False

    def stop() -> None:
        nonlocal overdue
        overdue = True
        options.set_load_cancellation_flag(True)

    try:
        with WATCHDOG.limit(time_limit_s, stop, "loading the model"):
            session = onnxruntime.InferenceSession(
                data,
                options,
                providers=["CPUExecutionProvider"],
                enable_fallback=0,
                disabled_optimizers=[NO_KERNEL],
            )
            metadata: dict[str, str] = session.get_modelmeta().custom_metadata_map
    except ORT_ERRORS as error:
        if overdue:
            raise InputError(
                f"{path}: loading took more than {time_limit_s:.3g} s and was stopped; if this "
                "machine is busy, try again"
            ) from None
        raise _unreadable(path, error) from None
    return session, metadata


def run_session(
    session: onnxruntime.InferenceSession,
    outputs: list[str],
    feed: dict[str, NDArray[Any]],
    time_limit_s: float,
) -> list[Any]:
    """Run a model that may come from a stranger.

    Args:
        session: what `load_session` returned.
        outputs: names of the wanted outputs.
        feed: arrays by the names of the inputs.
        time_limit_s: seconds that it may take.

    Raises:
        InputError: onnxruntime failed, or took too long.
    """
    options = onnxruntime.RunOptions()

    def stop() -> None:
        options.terminate = True

    try:
        with WATCHDOG.limit(time_limit_s, stop, "the model"):
            return list(session.run(outputs, feed, options))
    except ORT_ERRORS as error:
        if options.terminate:
            raise InputError(
                f"the model took more than {time_limit_s:.3g} s; it is stopped"
            ) from None
        raise InputError(f"the model failed to run: {_reason(error)}") from None


def check_threads(threads: int) -> None:
    """Check a number of threads of onnxruntime.

    Raises:
        InputError: it is out of range.
    """
    if not 1 <= threads <= MAX_THREADS:
        raise ParameterError("threads", f"need 1 to {MAX_THREADS}, got {threads}")


def _unreadable(path: Path, error: Exception) -> InputError:
    return InputError(f"{path}: not a readable ONNX model; export it again ({_reason(error)})")


@cache
def _bound_memory() -> None:
    """Give onnxruntime one pool of memory for all models of the process, of a limited size."""
    kind = onnxruntime.OrtAllocatorType.ORT_ARENA_ALLOCATOR
    memory = onnxruntime.OrtMemoryInfo("Cpu", kind, 0, onnxruntime.OrtMemType.DEFAULT)
    settings = onnxruntime.OrtArenaCfg({"max_mem": MAX_MEMORY_BYTES})
    onnxruntime.create_and_register_allocator(memory, settings)


def _reason(error: Exception) -> str:
    """The first line of an exception of onnxruntime, cut where it becomes long."""
    lines = str(error).splitlines()
    return lines[0][:160] if lines else type(error).__name__


def read_point(text: str) -> tuple[float, float]:
    """Read one of the four points of a flag, such as 10.5,20.

    Raises:
        ArgumentTypeError: the text is no such point.
    """
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        example = "10.5,20 400,22 398,310 12,305"
        raise ArgumentTypeError(f"need four points x,y, such as {example}") from None
    return x, y


def main() -> None:
    """Decode two captured images and print bits and scores as JSON."""
    from link.images.files import read_image  # needs Pillow, which the packed receiver lacks

    parser = Parser(prog="python -m export.runtime", description=main.__doc__)
    parser.add_argument("model", type=find_graph, help="an .onnx file, or a preset's name")
    parser.add_argument("original", type=Path, help="image of the original frame")
    parser.add_argument("embedded", type=Path, help="image of the embedded frame")
    for flag, text in (
        (
            "--corners",
            "of the displayed picture: top-left, top-right, bottom-right, bottom-left; "
            "without them the picture fills the images",
        ),
        ("--corners-embedded", "the same in the embedded frame; --corners where absent"),
    ):
        parser.add_argument(flag, type=read_point, nargs=4, metavar="x,y", help=text)
    add_pixel_limit(parser)
    # a leading blank keeps argparse from taking -0.5,-0.5 for a flag
    words = [re.sub(r"^(?=-[\d.]+,)", " ", word) for word in sys.argv[1:]]
    args = check_flags(parser.parse_args(words))
    decoder = Decoder(args.model)
    frames = read_image(args.original), read_image(args.embedded)
    pair = decoder.rectify(*frames, args.corners, args.corners_embedded)
    seen = patch_correlation(pair.original, decoder.layout) if decoder.layout.ratex else 1.0
    if seen < DECODED_CORRELATION:
        raise InputError(
            f"no ratex patches where the corners and the model's layout put them (correlation "
            f"{seen:.2f}); check the corners, their order, and that the display is in view"
        )
    if decoder.layout.pilots:
        toggled = abs(pilots_toggled(pair.original, pair.embedded, decoder.layout))
        if toggled < LEAST_TOGGLED:
            raise InputError(
                f"no pilots where the corners and the model's layout put them: their known bits do "
                f"not stand out ({toggled:.1f} standard errors, {LEAST_TOGGLED:g} needed); check "
                "the corners, their order, the model, and that the images show both states"
            )
    soft = decoder.decode(pair.original, pair.embedded)
    result: dict[str, Any] = {
        "bits": soft.bits.tolist(),
        "scores": [round(float(score), 4) for score in soft.scores],
        "head": [] if soft.head is None else [round(float(weight), 6) for weight in soft.head],
        "features": decoder.features,
        "layout": decoder.layout.to_dict(),
    }
    print(json.dumps(result))


if __name__ == "__main__":
    run_cli(main)
