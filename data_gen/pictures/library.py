"""The pictures that the display shows: photographs, generated slides, and the user's own.

The photographs ship inside the scikit-image and scikit-learn wheels, so nothing is downloaded.
A photograph belongs to one split only; the crops taken from it never cross over. built_in.json
lists what each split has, drawings by the first of their numbers and the one after the last.
"""

import json
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from data_gen.pictures.drawings import draw_picture
from link.errors import InputError, choose
from link.images import MIN_SIDE_PX, fit_picture, image_files
from link.images.files import read_image
from link.images.video import VideoReader
from link.outside import is_file

MIN_SOURCE_SIDE = 64
"""Smallest width and height, in pixels, of an image in the user's folder."""
MAX_TAKEN = 60
"""Largest number of pictures, a second apart, that are taken from a video."""


@dataclass(frozen=True, eq=False)
class Picture:
    """A picture that a display shows."""

    name: str
    """Name of the picture, the same on every call: "photo/<source>/<crop>" for a photograph,
    "<kind>/<number>" for a drawing, or the user's file name."""
    rgb: NDArray[np.uint8]
    """Pixels, (H, W, 3) uint8, RGB encoded."""


_BUILT_IN = json.loads(Path(__file__).with_name("built_in.json").read_text("utf-8"))


def load_pictures(split: str, width: int, height: int) -> list[Picture]:
    """Load the built-in pictures of a split: photographs, then slides, maps and posters.

    >>> pictures = load_pictures("test", 128, 96)
    >>> len(pictures), pictures[0].name, pictures[0].rgb.shape
    (15, 'photo/astronaut/0', (96, 128, 3))

    Args:
        split: "train" or "test"; no photograph and no drawing is in both.
        width: width of every picture, pixels.
        height: height of every picture, pixels.

    Returns:
        Pictures with `rgb` (height, width, 3) uint8, RGB encoded; the same bytes and the same
        order on every call.

    Raises:
        InputError: an unknown split, a width or height below 16, or a photograph that the
            installed scikit-image or scikit-learn does not hold.
    """
    chosen = choose(_BUILT_IN, split, "split")
    _check_size(width, height)
    pictures = []
    for resource, crops in chosen["photographs"].items():
        path = _installed(resource)
        source = read_image(path)
        for i, crop in enumerate(crops):
            rgb = _crop_and_resize(source, width, height, **crop)
            pictures.append(Picture(f"photo/{path.stem}/{i}", rgb))
    for kind, (first, end) in chosen["drawings"].items():
        for number in range(first, end):
            pictures.append(Picture(f"{kind}/{number}", draw_picture(kind, number, width, height)))
    return pictures


def load_folder(folder: Path, width: int, height: int) -> list[Picture]:
    """Load the user's own pictures, sorted by file name, centre-cropped and resized.

    Subfolders, hidden files and those that are no images by their suffix are passed over. Of a
    video, a frame is taken each second, `MAX_TAKEN` at most.

    Args:
        folder: holds the image files, or is a video file.
        width: width of every picture, pixels.
        height: height of every picture, pixels.

    Returns:
        Pictures with `rgb` (height, width, 3) uint8, RGB encoded, named by their files.

    Raises:
        InputError: no such folder or video, no image in it, an image that cannot be read or is
            smaller than 64x64, or a width or height below 16.
    """
    _check_size(width, height)
    pictures: list[Picture] = []
    if is_file(folder):
        for image, time in VideoReader(folder).timed_frames():
            if time >= len(pictures):
                rgb = fit_picture(image, width, height)
                pictures.append(Picture(f"{folder.name}/{len(pictures)}", rgb))
            if len(pictures) == MAX_TAKEN:
                break
        return pictures
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder or video")
    for path in image_files(folder):
        source = read_image(path)
        if min(source.shape[:2]) < MIN_SOURCE_SIDE:
            size = f"{source.shape[1]}x{source.shape[0]}"
            need = f"{MIN_SOURCE_SIDE}x{MIN_SOURCE_SIDE}"
            raise InputError(f"{path}: image is {size}, need at least {need} pixels")
        pictures.append(Picture(path.name, fit_picture(source, width, height)))
    return pictures


def _check_size(width: int, height: int) -> None:
    if min(width, height) < MIN_SIDE_PX:
        need = f"{MIN_SIDE_PX}x{MIN_SIDE_PX}"
        raise InputError(f"pictures of {width}x{height} asked for, need at least {need} pixels")


def _installed(resource: str) -> Path:
    """Find "package/path" in site-packages without importing the package."""
    package, _, inner = resource.partition("/")
    spec = find_spec(package)
    if spec is None or not spec.submodule_search_locations:
        raise InputError(f"{resource} is needed for the built-in pictures: install {package}")
    return Path(spec.submodule_search_locations[0]) / inner


def _crop_and_resize(
    rgb: NDArray[np.uint8],
    width: int,
    height: int,
    size: float = 1.0,
    x: float = 0.5,
    y: float = 0.5,
) -> NDArray[np.uint8]:
    """Cut a window of the displayed aspect out of a photograph, and resize it.

    Args:
        rgb: (H, W, 3) uint8, encoded.
        width: width of the result, pixels.
        height: height of the result, pixels.
        size: size relative to the largest window of that aspect, in (0, 1].
        x: share of the free width left of the window, in [0, 1].
        y: share of the free height above the window, in [0, 1].

    Returns:
        (height, width, 3) uint8, encoded.
    """
    source_height, source_width = rgb.shape[:2]
    scale = size * min(source_width / width, source_height / height)
    window_width = max(1, round(scale * width))
    window_height = max(1, round(scale * height))
    left = round((source_width - window_width) * x)
    top = round((source_height - window_height) * y)
    window = rgb[top : top + window_height, left : left + window_width]
    shrinks = window_width >= width and window_height >= height
    how = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(window, (width, height), interpolation=how), np.uint8)
