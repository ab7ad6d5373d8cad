"""Rays: visibility and materials by way of Mitsuba and Sionna RT, which live here and only here."""
