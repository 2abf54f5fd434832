"""Orbit determination: from directions to an orbit with its covariance."""
