"""
Body, room, paths and maps on one timeline
==========================================

`Recording.view` makes a page of a recording: the body in its room, the paths from the radar, and the maps, with one time cursor.
A notebook shows it in a cell, `save` writes it as one HTML file that opens from disk in any browser.

Press play, or click on the arc of a foot in the spectrogram: the foot lights up, and the line below says which paths its echoes
took. :doc:`/view` tells the rest.
"""

import t2d_rt as t2d

walk = t2d.place(t2d.trim(t2d.example("walk"), 1.0, 2.6), distance_m=3.5)
recording = t2d.simulate(walk, radar="table2", scene="empty_room", method="ellipsoid", reflections=1)
recording.view()
