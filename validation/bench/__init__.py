"""Speed on this machine: `make bench` writes results.json, bench.md and charts here, `--quick` a part of them to out/bench.

Every case runs in a process of its own, kernels warm. Ratios to a yardstick in the same process tell more than seconds.
"""
