"""`python -m ldsim`."""

from ldsim.cli.main import main

main(prog_name="ldsim")
