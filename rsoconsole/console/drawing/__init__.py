"""Characters and colours: block characters, plots, ASCII forms, and the layout of panes."""
