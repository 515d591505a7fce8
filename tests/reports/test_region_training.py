"""Films of the map's training show what they say, and train it."""

from pathlib import Path

import numpy as np
import pytest

from export.parity import Parity
from link.errors import InputError
from link.geometry import homography_from_corners, rectify, transform
from link.images import as_gray
from link.pilots import pilot_values
from link.presets import PRESETS
from receiver.pilots.toggling import find_toggling
from reports import region_training
from reports.region_training import (
    CAMERAS,
    RegionTrainConfig,
    cover,
    distance,
    draw_film,
    train_regions,
)


def test_cells_are_covered_as_corners_say() -> None:
    corners = np.array([[79.5, 39.5], [239.5, 39.5], [239.5, 203.5], [79.5, 203.5]])
    covered = cover(corners)
    assert covered[5:25, 10:30].min() > 0.9
    assert covered.sum() == pytest.approx(20 * 20.5, rel=0.03)  # the outline counts, too
    assert distance(corners[[1, 2, 3, 0]], corners) == 0


@pytest.mark.slow
def test_pilots_toggle_where_the_film_says_that_the_picture_is() -> None:
    """The strength of evidence tells, since pilots are met by chance once in e to the 20."""
    seen = 0
    for number in range(6):
        drawn = draw_film("train", 2, number)
        frames = [frame for _, frame in zip(range(12), drawn.frames, strict=False)]
        best = 0.0
        for name in {name for name, fps in CAMERAS if fps == drawn.fps}:
            layout = PRESETS[name].layout
            size = layout.width, layout.height
            views = []
            for frame in frames:
                corners = transform(frame.H_captured_from_display, drawn.picture)
                H = homography_from_corners(corners, *size)
                views.append(pilot_values(rectify(as_gray(frame.rgb), H, *size), layout))
            evidence, _ = find_toggling(views, layout, list(range(len(views))), drawn.fps)
            best = max(best, evidence)
        seen += best > 20
        assert drawn.shows_message or best < 20
    assert seen >= 3


@pytest.mark.slow
def test_a_run_trains_writes_the_graph_and_goes_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The run that goes on exports nothing, since an export takes long."""
    config = RegionTrainConfig(out=tmp_path / "run", number=1, held_out=1, steps=2, batch=2, jobs=1)
    train_regions(config)
    films = {file: file.read_bytes() for file in tmp_path.rglob("*.npz")}
    assert len(films) == 2
    first = (config.out / "decoder.pt").read_bytes()
    assert (config.out / "region.onnx").is_file()
    monkeypatch.setattr(region_training, "export_region", lambda *_: Parity(1, 1, 0, 0.0, 1.0, 0.5))
    train_regions(config)
    assert {file: file.read_bytes() for file in tmp_path.rglob("*.npz")} == films
    assert (config.out / "decoder.pt").read_bytes() == first
    assert "within the image" in capsys.readouterr().out
    with pytest.raises(InputError, match="number"):
        train_regions(RegionTrainConfig(number=0))
