"""The physics of the results: closed forms, exact series, Sionna RT's solver, and people as they were measured."""
