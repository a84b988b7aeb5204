"""``python -m pulsewright`` is the command line, where its script is not on the path."""

from pulsewright.app.cli import main

main()
