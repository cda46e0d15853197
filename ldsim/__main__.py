"""`python -m ldsim`."""

from ldsim.cli.app import main

main(prog_name="ldsim")
