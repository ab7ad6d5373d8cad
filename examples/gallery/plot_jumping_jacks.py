"""
Jumping jacks, by ellipsoids and by the mesh
============================================

Arms and legs swing sideways, so that little of their speed is radial; the body's rise and fall shows hardly at all
from the front. The ellipsoids' clean lines and the mesh's glints have much the same envelope.
"""

import t2d_rt as t2d

jacks = t2d.place(t2d.trim(t2d.example("jumping_jacks"), 1.0, 2.5), distance_m=2.5)
ellipsoids, mesh = t2d.simulate(jacks, method="ellipsoid"), t2d.simulate(jacks)
comparison = t2d.compare(ellipsoids, mesh)
print(comparison)

comparison.plot()
