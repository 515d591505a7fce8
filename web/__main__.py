"""Build the receiver as a web page: python -m web --out DIR [--serve PORT]."""

import json
from contextlib import suppress
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from link.cli import Parser, check_flags, run_cli
from link.errors import ParameterError
from web.host.site import build_site


class SiteHandler(SimpleHTTPRequestHandler):
    """Serves files with the types that browsers insist on, whatever this machine takes them for."""

    extensions_map: dict[str, str] = {  # noqa: RUF012 - as the class below declares it
        **SimpleHTTPRequestHandler.extensions_map,
        ".css": "text/css",
        ".html": "text/html",
        ".js": "text/javascript",
        ".svg": "image/svg+xml",
        ".wasm": "application/wasm",
    }


def main() -> None:
    """Write a folder that any static host can serve, and print its sizes as one line of JSON."""
    parser = Parser(prog="python -m web", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the page")
    parser.add_argument("--serve", type=int, help="then serve it to this machine, at this port")
    args = check_flags(parser.parse_args())
    site = build_site(args.out)
    report = {"out": str(args.out), "gzip_bytes": site.gzip_bytes, "files": site.sizes}
    print(json.dumps(report), flush=True)
    if args.serve is not None:
        serve(args.out, args.serve)


def serve(folder: Path, port: int) -> None:
    """Serve a folder to this machine alone, until somebody interrupts it.

    Raises:
        InputError: the port is taken, or none.
    """
    try:
        server = ThreadingHTTPServer(("127.0.0.1", port), partial(SiteHandler, directory=folder))
    except (OSError, OverflowError) as error:
        raise ParameterError("serve", f"{port}: {error}") from None
    with server, suppress(KeyboardInterrupt):
        server.serve_forever()


if __name__ == "__main__":
    run_cli(main)
