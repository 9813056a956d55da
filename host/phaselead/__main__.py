"""``python -m phaselead`` is the command ``phaselead``."""

from phaselead.cli import main

main(prog_name="phaselead")
