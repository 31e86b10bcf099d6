"""``python -m trailmark`` does what the console script ``trailmark`` does."""

import sys

from trailmark.cli import main

sys.exit(main())
