"""What the next hours bring over a site: limits, darkness, passes. Pure."""
