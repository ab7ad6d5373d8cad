"""Slow checks against what was worked out independently: `python -m validation`, results in report/.

physics/ holds the results against closed forms and measurements, methods/ the approximations against converged references,
robustness/ odd inputs, memory and interruptions; bench/ is speed (`python -m validation.bench`).
"""
