"""The page's receiver finds, follows and decodes the displays that it draws to get ready."""

import pytest
from web_fixtures import run_node_tests, write_fixture

from export.web.tables import layout_table
from link.presets import PRESETS


@pytest.mark.slow
def test_getting_ready_runs_every_stage(tmp_path) -> None:
    layouts = [layout_table(PRESETS[name].layout) for name in ("paper", "robust")]
    write_fixture(tmp_path, "layouts", layouts)
    run_node_tests("warm", tmp_path)
