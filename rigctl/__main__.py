"""``python -m rigctl`` is the command line, without the working folder on Python's path."""

import sys

if not sys.flags.safe_path:
    # A script there that has the name of a library, as serial.py, would run in its place.
    del sys.path[0]

from rigctl.cli import main

sys.exit(main())
