"""`python -m lis_grasp` is the command `lis-grasp`."""

import sys

from lis_grasp.cli.main import main

sys.exit(main())
