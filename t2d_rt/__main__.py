"""`python -m t2d_rt`: the command line, where the script t2d-rt is not on the path."""

import sys

from t2d_rt.cli import main

sys.exit(main())
