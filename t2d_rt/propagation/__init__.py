"""Rays: visibility and materials by Mitsuba and Sionna RT, which live here and only here."""
