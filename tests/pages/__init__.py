"""What the pages say, read back: commands as they are printed, JSON, the source itself."""
