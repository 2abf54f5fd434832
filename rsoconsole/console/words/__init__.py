"""The console's lines of text, cut to fit, and the contents of its plots. Pure."""
