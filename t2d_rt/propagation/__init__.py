"""Propagation by rays: paths, visibility and materials, by Mitsuba and Sionna RT, which are imported only here."""
