"""Pack the receiver for other programs: python -m web.package --out DIR.

Writes a wheel for Python, a package for npm, and the JSON Schema of the events of both, and prints
the sizes as one line of JSON. docs/embed.md shows how they are used.
"""

import json
from pathlib import Path

from link.cli import Parser, check_flags, run_cli
from link.files.lock import locked
from link.images import write_bytes
from web.package.npm import write_npm_package
from web.package.schema import events_schema
from web.package.wheel import write_wheel


def main() -> None:
    """Write the packages."""
    parser = Parser(prog="python -m web.package", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder for the packages")
    parser.add_argument(
        "--only", choices=("wheel", "npm"), help="leave the other one out; npm needs Node.js"
    )
    args = check_flags(parser.parse_args())
    schema = args.out / "events.schema.json"
    files = [schema]
    with locked(args.out):
        write_bytes(schema, json.dumps(events_schema(), indent=1).encode())
        if args.only != "npm":
            files.append(write_wheel(args.out))
        if args.only != "wheel":
            files.append(write_npm_package(args.out))
    sizes = {file.name: file.stat().st_size for file in files}
    print(json.dumps({"out": str(args.out), "files": sizes}))


if __name__ == "__main__":
    run_cli(main)
