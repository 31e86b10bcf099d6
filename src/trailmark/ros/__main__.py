"""``python -m trailmark.ros``: the node, as ``trailmark ros`` starts it."""

import sys

from trailmark.errors import TrailmarkError
from trailmark.ros import main

if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except KeyboardInterrupt:
        sys.exit(130)
    except TrailmarkError as error:
        sys.stderr.write(f"trailmark: error: {error}\n")
        sys.exit(2)
