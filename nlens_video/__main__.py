"""`python -m nlens_video`."""

import sys

from nlens_video.cli import main

sys.exit(main())
