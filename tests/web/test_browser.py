"""What Chromium needs besides itself."""

import socket
import struct
import time
from pathlib import Path

import pytest
from browser import serve_folder

CLOSE_AT_ONCE = struct.pack("ii", 1, 0)
"""Value of SO_LINGER at which a connection is reset instead of being ended in order."""


def test_a_browser_that_leaves_early_is_no_error(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "large").write_bytes(bytes(50_000_000))
    with serve_folder(tmp_path) as address:
        port = int(address.strip("/").rpartition(":")[2])
        with socket.create_connection(("127.0.0.1", port)) as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, CLOSE_AT_ONCE)
            connection.sendall(b"GET /large HTTP/1.0\r\n\r\n")
            assert b"200 OK" in connection.recv(100)
        time.sleep(0.3)  # until the server has noticed
    assert capfd.readouterr() == ("", "")
