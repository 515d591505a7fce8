"""Run a study: python -m lab NAME, with flags that python -m lab NAME --help lists.

Without a name, all studies are listed.
"""

import sys
from importlib import import_module
from typing import Any

from lab.study import Study, run_study
from link.cli import run_cli
from link.errors import choose

STUDIES = {
    "ablation": ("lab.ablation", "which switch of the decoder pays, and where"),
    "pilot_search": ("lab.films.pilot_search", "how often displays are found by their pilots"),
    "rates": ("lab.films.rates", "how fast presets deliver a message"),
}
"""Module that holds each study as ``STUDY``, and the question that it answers, by its name."""


def main() -> None:
    """Run the study that the command line names, or list all of them."""
    name, *arguments = sys.argv[1:] or ["--help"]
    if name in ("-h", "--help"):
        print(f"{__doc__}\n{list_studies()}")
        return
    run_study(find_study(name), arguments)


def find_study(name: str) -> Study[Any, Any]:
    """Import the study of a name.

    Raises:
        InputError: there is none; the message lists the names.
    """
    module, _ = choose(STUDIES, name, "study")
    study: Study[Any, Any] = import_module(module).STUDY
    return study


def list_studies() -> str:
    """Names of all studies with their questions, a line each.

    >>> print(list_studies().splitlines()[0])
    ablation         which switch of the decoder pays, and where
    """
    return "\n".join(f"{name:16} {question}" for name, (_, question) in STUDIES.items())


if __name__ == "__main__":
    run_cli(main)
