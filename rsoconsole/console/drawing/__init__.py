"""Characters and colours: blocks, plots, the disc of the sky, and where panes lie."""
