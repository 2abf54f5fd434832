"""Hours ahead over a site: limits, darkness, passes. Pure."""
