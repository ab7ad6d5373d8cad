"""Slow checks against what was worked out independently: `python -m validation`, results in report/.

physics/ holds the results against closed forms and measurements, methods/ the approximations against converged references,
robustness/ odd inputs, memory and interruptions; bench/ is speed (`python -m validation.bench`), gpu/ compares a GPU with a CPU.
"""

from __future__ import annotations

import os

from t2d_rt.core.disk_cache import VARIABLE

os.environ.setdefault(VARIABLE, "off")  # times are those of a first recording
