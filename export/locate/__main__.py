"""Find the display in photographs: python -m export.locate IMAGE... ."""

from export.locate.find import main
from link.errors import run_cli

if __name__ == "__main__":
    run_cli(main)
