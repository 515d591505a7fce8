"""Write a page on which a person can see the flicker: python -m reports.visibility.flicker.

Two settings toggle side by side over one picture: the presets `paper` and `hidden`. Beneath each
stands its computed contrast over threshold, for the standard display; rates can be switched.
"""

import base64
import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import tyro

from data_gen.pictures.library import load_pictures
from link.cli import read_flags, run_cli
from link.embed import with_head_room
from link.errors import at_least
from link.images import write_bytes
from link.layout import make_layout
from link.presets import PRESETS
from reports.visibility.presets import check_seconds, seen_of, viewing_of

TEMPLATE = Path(__file__).with_name("flicker.html")
"""Page with `__PAGE__` where the settings and the picture go as JSON."""
SIDES = {
    "The preset paper: 8 × 8 blocks, on-off, κ 3": PRESETS["paper"],
    "The preset hidden: 48 × 64 blocks, antipodal, κ 1": PRESETS["hidden"],
}
"""Settings that stand side by side, by what the page calls them."""
PAGE_RATES = (15, 30, 60, 120)
"""States a second that the page offers."""


@dataclass(frozen=True)
class FlickerConfig:
    """Write a self-contained HTML page that flickers."""

    out: Path = Path("runs/flicker.html")
    """File of the page."""
    width: int = 512
    """Width of the picture, pixels."""
    height: int = 384
    """Height of the picture, pixels."""
    seconds: float = 40.0
    """Length of the random messages whose visibility is printed, in seconds."""
    seed: int = 0
    """Seed of the random messages."""


def side_by_side(config: FlickerConfig) -> dict[str, Any]:
    """Gather what the page needs: the picture, the settings, and how visible each is."""
    picture = load_pictures("test", config.width, config.height)[0].rgb
    kappa = max(preset.kappa for preset in SIDES.values())
    _, png = cv2.imencode(".png", cv2.cvtColor(with_head_room(picture, kappa), cv2.COLOR_RGB2BGR))
    settings = []
    for name, preset in SIDES.items():
        seen = {}
        for rate in PAGE_RATES:
            at_rate = replace(preset, state_hz=rate)
            block, screen = (
                seen_of(at_rate, config.seed, config.seconds, where, refresh_hz=120)
                for where in ("block", "screen")
            )
            seen[rate] = {"block": block.mean, "high": block.high, "screen": screen.mean}
        settings.append(
            {
                "name": name,
                "rows": preset.layout.rows,
                "cols": preset.layout.cols,
                "kappa": preset.kappa,
                "antipodal": preset.line_code != "on_off",
                "states_hz": preset.state_hz,
                "seen": seen,
            }
        )
    viewing = viewing_of(next(iter(SIDES.values())))
    return {
        "width": config.width,
        "height": config.height,
        "image": f"data:image/png;base64,{base64.b64encode(bytes(png)).decode()}",
        "settings": settings,
        "viewing": (
            "Computed by elaTCSF (Cai et al., SIGGRAPH Asia 2024) for random messages over gray "
            f"{viewing.picture_level:g} that fill a {viewing.diagonal_inch:g}-inch 16:9 display of "
            f"{viewing.white_cd_m2:g} cd/m² seen from {viewing.distance_m:g} m. On this page the "
            "picture is smaller, and its own grays and texture count: look for yourself."
        ),
    }


def write_flicker_page(config: FlickerConfig) -> None:
    """Write the page.

    Raises:
        InputError: the picture is too small, or the page cannot be written.
    """
    page = TEMPLATE.read_text("utf-8").replace("__PAGE__", json.dumps(side_by_side(config)), 1)
    write_bytes(config.out, page.encode())


def main() -> None:
    """Write the page and say where it is."""
    config = read_flags(lambda: tyro.cli(FlickerConfig))
    at_least(0, seed=config.seed)
    check_seconds(config.seconds)
    for preset in SIDES.values():
        make_layout(preset.layout.rows, preset.layout.cols, config.width, config.height, 0)
    write_flicker_page(config)
    print(f"written: {config.out}")


if __name__ == "__main__":
    run_cli(main)
