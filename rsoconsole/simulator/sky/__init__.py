"""What crosses a simulated field: satellites, stars, clouds, other traffic."""
