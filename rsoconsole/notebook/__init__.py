"""A session looked at afterwards: its figures for print."""
