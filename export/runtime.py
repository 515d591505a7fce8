"""Decode frame pairs with numpy, OpenCV and onnxruntime alone.

python -m export.runtime MODEL ORIGINAL EMBEDDED [--corners x,y x,y x,y x,y]
"""

import argparse
import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import ArrayLike, NDArray
from onnxruntime.capi import onnxruntime_pybind11_state as ort_errors

from link.errors import InputError, ParameterError, run_cli
from link.frames import Captured, Rectified, SoftBits, check_same_size
from link.geometry import as_corners
from link.images import as_batch, read_image
from link.layout import MIN_BLOCK_PX, Layout
from link.ratex import visibility

ORT_ERRORS = (
    ort_errors.EPFail,
    ort_errors.Fail,
    ort_errors.InvalidArgument,
    ort_errors.InvalidGraph,
    ort_errors.InvalidProtobuf,
    ort_errors.NotImplemented,
    ort_errors.RuntimeException,
)
"""Exceptions of onnxruntime that a damaged or foreign model raises."""
MIN_VISIBILITY = 0.8
"""Smallest `link.ratex.visibility` of frames that the command decodes; simulated captures up to 70
degrees have 0.97 and more."""
FORMAT = "1"
"""Version of the metadata, and of the graph's inputs and outputs, that this code reads."""


class Decoder:
    """A decoder in an ONNX file, which carries its own layout.

    Args:
        path: file that `export.to_onnx` wrote.
        threads: number of threads of onnxruntime.

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

    def __init__(self, path: Path | str, threads: int = 2) -> None:
        path = Path(path)
        if not path.is_file():
            raise InputError(f"{path}: no such model; export one with python -m export.to_onnx RUN")
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.log_severity_level = 4
        try:
            self._session = onnxruntime.InferenceSession(
                path.read_bytes(), options, providers=["CPUExecutionProvider"]
            )
            self.metadata: dict[str, str] = self._session.get_modelmeta().custom_metadata_map
        except (*ORT_ERRORS, UnicodeDecodeError) as error:
            reason = str(error).splitlines()[0][:160]
            raise InputError(
                f"{path}: not a readable ONNX model; export it again ({reason})"
            ) from None
        names = [
            [node.name for node in nodes]
            for nodes in (self._session.get_inputs(), self._session.get_outputs())
        ]
        if self.metadata.get("format") != FORMAT or names != [
            ["original", "embedded"],
            ["scores", "head"],
        ]:
            raise InputError(f"{path}: not a decoder of this version; export it again")
        try:
            self.layout = Layout.from_dict(json.loads(self.metadata["layout"]))
        except (KeyError, json.JSONDecodeError):
            raise InputError(f"{path}: carries no layout; export it again") from None

    def decode(
        self,
        original: NDArray[np.uint8],
        embedded: NDArray[np.uint8],
        corners: ArrayLike | None = None,
        corners_embedded: ArrayLike | None = None,
    ) -> SoftBits:
        """Decode one frame pair.

        Args:
            original: (H, W) or (H, W, 3) uint8, encoded RGB. Without ``corners`` the frame is
                already rectified: the displayed picture fills it, at any size.
            embedded: uint8 of the shape of ``original``, encoded RGB.
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
        if scores.shape != (1, self.layout.n_bits) or not np.isfinite(scores).all():
            raise InputError("the model returned no valid scores; export it again")
        return SoftBits(scores[0].astype(np.float64), head[0].astype(np.float64))

    def run(
        self, original: NDArray[np.uint8], embedded: NDArray[np.uint8]
    ) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Run the graph on a batch of rectified frame pairs.

        Args:
            original: (B, 3, H, W) uint8, encoded RGB.
            embedded: (B, 3, H, W) uint8, encoded RGB.

        Returns:
            scores (B, n_bits) float32, and the fitted heads (B, features) float32.

        Raises:
            InputError: onnxruntime failed.
        """
        try:
            scores, head = self._session.run(
                ["scores", "head"], {"original": original, "embedded": embedded}
            )
        except ORT_ERRORS as error:
            reason = str(error).splitlines()[0][:160]
            raise InputError(f"the model failed to run: {reason}") from None
        return scores, head

    def rectify(
        self,
        original: NDArray[np.uint8],
        embedded: NDArray[np.uint8],
        corners: ArrayLike | None = None,
        corners_embedded: ArrayLike | None = None,
    ) -> Rectified:
        """Resample frames to the displayed picture, or check that they are rectified already.

        Args:
            original: (H, W) or (H, W, 3) uint8, encoded RGB.
            embedded: uint8 of the shape of ``original``, encoded RGB.
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
            raise ParameterError("corners_embedded", "is given without corners")
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
        return Rectified(frames[0], frames[1], layout)


def parse_corners(points: list[str] | None, flag: str) -> NDArray[np.float64] | None:
    """Read four points from the command line.

    Args:
        points: four texts "x,y", or None where the flag is absent.
        flag: that the error names.

    Returns:
        (4, 2) float64, or None.

    Raises:
        InputError: not four points.
    """
    if points is None:
        return None
    try:
        corners = np.array([[float(v) for v in point.split(",")] for point in points])
    except ValueError:
        corners = np.empty(0)
    if corners.shape != (4, 2):
        raise InputError(f"{flag}: need four points x,y, such as 10.5,20 400,22 398,310 12,305")
    return corners


def main() -> None:
    """Decode two captured images and print bits and scores as JSON."""
    parser = argparse.ArgumentParser(prog="python -m export.runtime", description=main.__doc__)
    parser.add_argument("model", type=Path, help="an .onnx file")
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
        parser.add_argument(flag, nargs=4, metavar="x,y", help=text)
    # a leading blank keeps argparse from taking -0.5,-0.5 for a flag
    args = parser.parse_args([re.sub(r"^(?=-[\d.]+,)", " ", word) for word in sys.argv[1:]])
    corners = parse_corners(args.corners, "--corners")
    corners_embedded = parse_corners(args.corners_embedded, "--corners-embedded")
    decoder = Decoder(args.model)
    frames = read_image(args.original), read_image(args.embedded)
    pair = decoder.rectify(*frames, corners, corners_embedded)
    seen = visibility(pair.original, decoder.layout)
    if seen < MIN_VISIBILITY:
        raise InputError(
            f"no ratex patches where the corners and the model's layout put them (correlation "
            f"{seen:.2f}); check the corners, their order, and that the display is in view"
        )
    soft = decoder.decode(pair.original, pair.embedded)
    result: dict[str, Any] = {
        "bits": soft.bits.tolist(),
        "scores": [round(float(score), 4) for score in soft.scores],
        "head": [] if soft.head is None else [round(float(weight), 6) for weight in soft.head],
        "features": json.loads(decoder.metadata["features"]),
        "layout": decoder.layout.to_dict(),
    }
    print(json.dumps(result))


if __name__ == "__main__":
    run_cli(main)
