"""Fixtures for the page's JavaScript: Python writes what it computes, and node's tests compare."""

import base64
import json
import os
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT

from export.web.constants import write_constants
from export.web.site import build_site

WEB = ROOT / "export" / "web"
DTYPES = ("uint8", "uint16", "int32", "float32", "float64")


def write_fixture(folder, name, values):
    """Write values (numbers, texts, lists, dicts, arrays of `DTYPES`) for `readFixture` of node."""

    def encoded(value):
        if isinstance(value, np.generic):
            return value.item()
        array = np.ascontiguousarray(value)
        if array.dtype == np.bool_:
            array = array.astype(np.uint8)
        if array.dtype == np.int64:
            array = array.astype(np.int32)
        assert array.dtype.name in DTYPES, array.dtype
        data = base64.b64encode(array.tobytes()).decode()
        return {"dtype": array.dtype.name, "shape": array.shape, "base64": data}

    (Path(folder) / f"{name}.json").write_text(json.dumps(values, default=encoded))


def run_node_tests(name, folder):
    """Run export/web/tests/NAME.test.js on the fixtures of a folder."""
    if shutil.which("node") is None or not (WEB / "node_modules").is_dir():
        pytest.skip("needs node, and npm ci in export/web")
    write_constants()
    done = subprocess.run(
        ["node", f"tests/{name}.test.js"],
        cwd=WEB,
        env={**os.environ, "FIXTURES": str(folder)},
        capture_output=True,
        text=True,
        timeout=300,
    )
    assert done.returncode == 0, done.stdout + done.stderr


def built_site(make_once):
    """The page's site, built once a session."""
    if shutil.which("npm") is None and not (WEB / "node_modules").is_dir():
        pytest.skip("needs Node.js")
    return make_once("site", lambda empty: build_site(empty / "web")) / "web"
