"""`python -m t2d_rt.cli`."""

import sys

from t2d_rt.cli import main

sys.exit(main())
