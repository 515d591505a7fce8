"""Build the receiver as a web page: python -m web --out DIR."""

import json
from pathlib import Path

from link.cli import Parser, check_flags, run_cli
from web.host.site import build_site


def main() -> None:
    """Write a folder that any static host can serve, and print its sizes as one line of JSON."""
    parser = Parser(prog="python -m web", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the page")
    args = check_flags(parser.parse_args())
    site = build_site(args.out)
    report = {"out": str(args.out), "gzip_bytes": site.gzip_bytes, "files": site.sizes}
    print(json.dumps(report))


if __name__ == "__main__":
    run_cli(main)
