#!/usr/bin/env bash
# On a machine with a CUDA device, in the repository's root, with the package's requirements installed: which of Dr.Jit's CUDA backend
# and OptiX work, then each case against the reference that a CPU made, and what it takes. Some four minutes.
set -uo pipefail
nvidia-smi --query-gpu=name,memory.total,driver_version --format=csv,noheader
python3 - <<'P'
import time
import drjit as dr
print("Dr.Jit", dr.__version__, "CUDA", dr.has_backend(dr.JitBackend.CUDA), "LLVM", dr.has_backend(dr.JitBackend.LLVM), flush=True)
import drjit.cuda as cuda
x = dr.arange(cuda.Float32, 1 << 24)
y = dr.sin(x); dr.eval(y); dr.sync_thread()
start = time.perf_counter()
for _ in range(20):
    y = dr.sin(x + y); dr.eval(y)
dr.sync_thread()
print(f"{20 * (1 << 24) / (time.perf_counter() - start):.3g} sines a second", flush=True)
import mitsuba as mi
mi.set_variant("cuda_ad_mono_polarized")
scene = mi.load_dict({"type": "scene", "shape": {"type": "rectangle"}})
print("OptiX ray test:", scene.ray_test(mi.Ray3f(mi.Point3f(0, 0, 3), mi.Vector3f(0, 0, -1))), flush=True)
P
python3 -m validation.gpu "$@"
