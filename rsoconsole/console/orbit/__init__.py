"""The orbit pane: its contents at one instant, and its lines."""
