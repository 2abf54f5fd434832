"""Outlook for a site over the next hours: limits, darkness, satellite passes. Pure."""
