"""The page's receiver finds, follows and decodes the displays that it draws to get ready."""

import pytest

from link.presets import PRESETS

LAYOUTS = [PRESETS[name].layout for name in ("paper", "robust")]


@pytest.mark.slow
@pytest.mark.parametrize("layout", LAYOUTS, ids=["patches", "pilots"])
def test_frame_pairs_are_decoded(port, layout) -> None:
    assert port("receive/warm.js").warmUp([layout]) >= 2


def test_nothing_is_read_when_there_is_no_time(port) -> None:
    assert port("receive/warm.js").warmUp(LAYOUTS, 0) == 0
