"""Pack the page's receiver as an npm package, with types and the same events as Python's."""

import json
import shutil
import tempfile
from pathlib import Path

from link import __version__
from link.images import write_bytes
from link.modules import ROOT
from web.host.constants import EVENTS, write_constants
from web.host.site import WEB, install_packages, run_node, write_presets
from web.package.schema import events_schema


def write_npm_package(folder: Path) -> Path:
    """Write the package, as ``npm install`` takes it, into a folder that is made if it is missing.

    Raises:
        InputError: Node.js is missing or fails, or the folder cannot be written.
    """
    install_packages()
    write_constants()
    with tempfile.TemporaryDirectory() as temporary:
        package = Path(temporary) / "package"
        write_presets(package)
        needed = json.loads(run_node(["node", "package/build.mjs", str(package)]))
        compiler = ["node", "node_modules/typescript/bin/tsc", "--noEmit", "false", "--noCheck"]
        types = Path(temporary) / "types"
        run_node([*compiler, "--declaration", "--emitDeclarationOnly", "--outDir", str(types)])
        for name in ("index", "live", "errors"):
            declared = (types / "package" / f"{name}.d.ts").read_text("utf-8")
            declared = declared.replace("../generated/events.js", "./events.js")
            if name == "index":
                declared += 'export * from "./events.js";\n'
            (package / f"{name}.d.ts").write_text(declared, "utf-8")
        shutil.copy(EVENTS, package / "events.d.ts")
        shutil.copy(ROOT / "LICENSE", package)
        shutil.copy(WEB / "host" / "opencv" / "opencv.wasm", package)
        shutil.copy(WEB / "host" / "opencv" / "LICENSE", package / "LICENSE-opencv")
        shutil.copy(ROOT / "docs" / "embed.md", package / "README.md")
        (package / "events.schema.json").write_text(json.dumps(events_schema(), indent=1))
        (package / "package.json").write_text(json.dumps(manifest(needed), indent=2))
        packing = ["npm", "pack", str(package), "--pack-destination", temporary]
        run_node([*packing, "--ignore-scripts"])
        (packed,) = Path(temporary).glob("*.tgz")
        write_bytes(folder / packed.name, packed.read_bytes())
    return folder / packed.name


def manifest(needed: list[str]) -> dict[str, object]:
    """Make the content of package.json.

    Args:
        needed: names of the packages that the script imports, in the versions of the page.
    """
    pinned = json.loads((WEB / "package.json").read_text("utf-8"))["dependencies"]
    entry = {"types": "./index.d.ts", "default": "./index.js"}
    return {
        "name": "oorc-receiver",
        "version": __version__,
        "description": "Read messages that a display hides in its picture, from camera frames",
        "license": "Apache-2.0",
        "type": "module",
        "exports": {".": entry, "./*": "./*"},
        "types": "./index.d.ts",
        "engines": {"node": ">=20.16"},
        "dependencies": {name: pinned[name] for name in needed},
    }
