"""``python -m rigctl`` is the command line."""

import sys

from rigctl.cli import main

sys.exit(main())
