"""What there is to record, as plain data, and how it is set up: targets placed, on one clock, checked against the room."""
