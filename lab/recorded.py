"""Make a set of captures of photographs: python -m lab.recorded PHOTOS --sent DIR.

The display showed, one after another, the states that `python -m sender --out DIR` wrote. What
was sent in each frame pair is read from these states, and where the display is from the
photographs. docs/recording.md tells how to take them.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import tyro
from numpy.typing import NDArray
from tqdm import tqdm

from link.captures import MANIFEST
from link.cli import check_flags, run_cli
from link.embed import check_kappa
from link.errors import InputError
from link.geometry import in_image
from link.images import image_files, intensity, read_image, write_bytes
from link.layout import Layout, block_mean
from link.outside import read_json
from receiver.locate.find import locate
from sender.write import SENT


@dataclass(frozen=True)
class RecordedConfig:
    """Photographs of states that were shown one after another, two a frame pair."""

    photos: tyro.conf.Positional[Path]
    """Folder of the photographs; by name they follow the states. The manifest is written there."""
    sent: Path
    """Folder that `python -m sender` wrote: state_00000.png, ..., and sent.json."""
    pair: str = "own"
    """Name of camera and display, by which tables group."""
    view: Annotated[float | None, tyro.conf.arg(name="view")] = None
    """Angle between the camera and the normal of the display, degrees."""
    handheld: bool = False
    """Look for the display in every photograph, not in the first of each pair alone."""
    unknown: bool = False
    """Leave out what was sent."""


def main() -> None:
    """Locate, read what was sent, write the manifest."""
    config = check_flags(tyro.cli(RecordedConfig, prog="python -m lab.recorded"))
    layout, kappa = read_sent(config.sent)
    states = sorted(config.sent.glob("state_*.png"))
    if not config.photos.is_dir():
        raise InputError(f"{config.photos}: no such folder of photographs")
    photos = image_files(config.photos)
    if not states or len(states) % 2 or len(photos) % len(states):
        raise InputError(
            f"{config.photos}: {len(photos)} photographs of {len(states)} states; give one of each "
            "state, or the same number of each round"
        )
    lines = []
    for number in tqdm(range(0, len(photos), 2), unit="pair", desc="locate"):
        original, embedded = photos[number : number + 2]
        first = number % len(states)
        entry: dict[str, Any] = {
            "original": original.name,
            "embedded": embedded.name,
            "layout": layout.to_dict(),
            "corners": corners_in(original, layout),
            "kappa": kappa,
            "pair": config.pair,
            "picture": states[first].name,
        }
        if config.handheld:
            entry["corners_embedded"] = corners_in(embedded, layout)
        if config.view is not None:
            entry["view_deg"] = config.view
        if not config.unknown:
            entry["bits"] = sent_bits(states[first : first + 2], layout, kappa).tolist()
        lines.append(json.dumps(entry))
    write_bytes(config.photos / MANIFEST, ("\n".join(lines) + "\n").encode())
    print(f"{len(lines)} frame pairs: {config.photos / MANIFEST}")


def read_sent(folder: Path) -> tuple[Layout, int]:
    """Read layout and kappa of what was shown from sent.json.

    Raises:
        InputError: the file is missing or damaged.
    """
    file = folder / SENT
    try:
        report = read_json(file)
        if not isinstance(report, dict) or type(report.get("kappa")) is not int:
            raise InputError(f"{file}: need layout and kappa")
        return Layout.from_dict(report.get("layout")), check_kappa(report["kappa"])
    except InputError as error:
        raise InputError(
            f"--sent: {file} is missing or damaged ({error}); python -m sender PICTURE "
            f"--message TEXT --out {folder} writes it"
        ) from None


def sent_bits(states: Sequence[Path], layout: Layout, kappa: int) -> NDArray[np.intp]:
    """Read the bits of a frame pair from its two states: 1 where the second is brighter.

    Args:
        states: files of the original and of the embedded state.
        layout: layout of what was shown.
        kappa: gray levels added to a block that carries a 1.

    Returns:
        (n_bits,) of 0 or 1.
    """
    original, embedded = (intensity(read_image(state)) for state in states)
    change = block_mean((255 * (embedded - original)).astype(np.float64), layout.rows, layout.cols)
    bits = (change > kappa / 2)[layout.message_mask]
    return np.asarray(bits, np.intp)


def corners_in(photo: Path, layout: Layout) -> list[list[float]]:
    """Locate the display in a photograph.

    Returns:
        four corners (x, y) in pixels, to two digits.

    Raises:
        InputError: the photograph shows no display, or not all of one.
    """
    image = read_image(photo)
    found = locate(image, layout)
    if found is None:
        raise InputError(f"{photo}: no display found; retake it, or write its corners by hand")
    if not in_image(found.corners, image.shape).all():
        raise InputError(f"{photo}: the display is not wholly in the image; retake it")
    return np.round(found.corners, 2).tolist()  # type: ignore[no-any-return]


if __name__ == "__main__":
    run_cli(main)
