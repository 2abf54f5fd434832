"""The console's lines of text, made to fit, and its plots' contents. Pure."""
