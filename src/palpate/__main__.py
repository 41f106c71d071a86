"""`python -m palpate` is the `palpate` command."""

from palpate.cli import main

main()
