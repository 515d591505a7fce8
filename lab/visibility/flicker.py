"""Write a page on which a person can see the flicker, runs/flicker/flicker.html.

Two settings toggle side by side over one picture: the presets `paper` and `hidden`. Beneath each
stands its computed contrast over threshold, for the standard display; rates can be switched.
"""

import base64
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2

from data_gen.pictures.library import load_pictures
from lab.study import Picture, Results, Study, StudyFlags, Workshop
from lab.visibility.presets import check_seconds, seen_of, viewing_of
from link.embed import with_head_room
from link.layout import make_layout
from link.presets import PRESETS
from reports.render.tables import Table

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
class FlickerFlags(StudyFlags):
    """Write a self-contained HTML page that flickers."""

    width: int = 512
    """Width of the picture, pixels."""
    height: int = 384
    """Height of the picture, pixels."""
    seconds: float = 40.0
    """Length of the random messages whose visibility is printed, in seconds."""


@dataclass(frozen=True)
class FlickerPage:
    """What the page shows."""

    page: dict[str, Any]
    """Picture, settings and their visibility, as the script of the page reads them."""


def side_by_side(flags: FlickerFlags, workshop: Workshop) -> FlickerPage:
    """Gather what the page needs: the picture, the settings, and how visible each is."""
    picture = load_pictures("test", flags.width, flags.height)[0].rgb
    kappa = max(preset.kappa for preset in SIDES.values())
    _, png = cv2.imencode(".png", cv2.cvtColor(with_head_room(picture, kappa), cv2.COLOR_RGB2BGR))
    settings = []
    for name, preset in SIDES.items():
        seen: dict[str, Any] = {}
        for rate in PAGE_RATES:
            at_rate = replace(preset, state_hz=rate)
            block, screen = (
                seen_of(at_rate, flags.seed, flags.seconds, where, refresh_hz=120)
                for where in ("block", "screen")
            )
            seen[str(rate)] = {"block": block.mean, "high": block.high, "screen": screen.mean}
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
    page = {
        "width": flags.width,
        "height": flags.height,
        "image": f"data:image/png;base64,{base64.b64encode(bytes(png)).decode()}",
        "settings": settings,
        "viewing": (
            "Computed by elaTCSF (Cai et al., SIGGRAPH Asia 2024) for random messages over gray "
            f"{viewing.picture_level:g} that fill a {viewing.diagonal_inch:g}-inch 16:9 display of "
            f"{viewing.white_cd_m2:g} cd/m² seen from {viewing.distance_m:g} m. On this page the "
            "picture is smaller, and its own grays and texture count: look for yourself."
        ),
    }
    return FlickerPage(page)


def check_flicker(flags: FlickerFlags) -> None:
    """Raise an `InputError` that names the first flag with a wrong value."""
    check_seconds(flags.seconds)
    for preset in SIDES.values():
        make_layout(preset.layout.rows, preset.layout.cols, flags.width, flags.height, 0)


def seen_beside(results: Mapping[str, Results[FlickerPage]]) -> dict[str, str]:
    """Tabulate how visible one block of each setting is at each rate."""
    sides = results["flicker"].content.page["settings"]
    rows = [
        [side["name"], *(f"{side['seen'][str(rate)]['block']:.2f}" for rate in PAGE_RATES)]
        for side in sides
    ]
    heads = ["contrast over threshold", *(f"{rate} states/s" for rate in PAGE_RATES)]
    return {"flicker": Table(heads, rows).markdown()}


def flicker_page(results: Mapping[str, Results[FlickerPage]]) -> dict[str, Picture]:
    """Make the page."""
    shown = json.dumps(results["flicker"].content.page)
    return {"flicker.html": TEMPLATE.read_text("utf-8").replace("__PAGE__", shown, 1).encode()}


STUDY = Study(
    name="flicker",
    flags=FlickerFlags,
    content=FlickerPage,
    measure=side_by_side,
    blocks=seen_beside,
    pictures=flicker_page,
    check=check_flicker,
)
"""The study that `python -m lab flicker` runs."""
