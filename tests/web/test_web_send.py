"""The page that sends makes the loops that export.send makes, and its visitors are told what is wrong."""

import base64
import json
import re
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import cases
from numpy.typing import NDArray
from port import Port, same

from export.send.player import write_player
from export.web.tables import send_preset
from link.code.authenticate import sign
from link.code.framing import encode
from link.layout import make_layout
from link.loop import Loop
from link.presets import PRESETS
from link.strength import block_steps
from link.types import Image

KEY = bytes(range(32))
PACKED = ("offsets", "patches", "pictures", "steps")
"""Keys of a loop whose arrays zlib packs, which is not everywhere the same."""


def picture(width: int = 512, height: int = 384, seed: int = 0) -> Image:
    """Noise over all levels on one side, on the other a smooth ramp from black to white."""
    rng = np.random.default_rng(seed)
    drawn = rng.integers(0, 256, (height, width, 3), dtype=np.uint8)
    ramp = np.linspace(0, 255, height).round().astype(np.uint8)
    drawn[:, : width // 2] = ramp[:, None, None]
    return drawn


def unpacked(loop: dict[str, Any]) -> dict[str, Any]:
    """A loop with its arrays as bytes."""

    def opened(held: Any) -> Any:
        if isinstance(held, list):
            return [opened(each) for each in held]
        return held and zlib.decompress(base64.b64decode(held))

    return {key: opened(held) if key in PACKED else held for key, held in loop.items()}


def sent_loop(file: Path) -> dict[str, Any]:
    held = re.search(r'<script type="application/json" id="loop">(.*?)</script>', file.read_text())
    assert held
    loop: dict[str, Any] = json.loads(held[1])
    return unpacked(loop)


@cases((512, 384, 48, 64), (130, 97, 9, 16), (600, 800, 24, 32))
def test_blocks_are_as_strong_as_python_makes_them(
    width: int, height: int, rows: int, cols: int, port: Port
) -> None:
    layout = make_layout(rows, cols, width, height, modulation="antipodal", pilots="auto")
    drawn = picture(width, height)
    given = {"width": width, "height": height, "data": drawn.reshape(-1)}
    found = port("link/strength.js").blockSteps(given, rows, cols)
    assert len(set(found.tolist())) > 8
    same(found, block_steps(drawn, layout))


@pytest.mark.parametrize("size", [(512, 384), (384, 512), (802, 600)], ids=str)
@pytest.mark.parametrize("name", PRESETS)
def test_loops_are_those_of_python(
    name: str, size: tuple[int, int], port: Port, tmp_path: Path
) -> None:
    preset, drawn = PRESETS[name], picture(*size)
    if size == (802, 600):
        drawn[:] = drawn[:, :, :1]  # gray
    message, signed = sign(b"Gr\xc3\xbc\xc3\x9fe", KEY, 7), size == (384, 512)
    bits = encode(message, preset.layout.n_bits, signed=signed)
    loop = Loop(preset.layout, preset.kappa, bits, lambda: iter([drawn]), even=preset.even)
    table = json.loads(json.dumps(send_preset(name, preset)))
    write_player(tmp_path / "player.html", loop, preset.state_hz, table["loop"]["flicker"])
    given = {"width": size[0], "height": size[1], "data": drawn.reshape(-1)}
    content = {"data": message, "signed": signed}
    found = vars(port("send/loop.js").makeLoop(table, content, given))
    assert unpacked(found) == sent_loop(tmp_path / "player.html")
