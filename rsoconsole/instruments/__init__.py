"""The world outside: INDI camera and mount, plate-solver process, clock, frame files."""
