"""The orbit pane: what can be said of an orbit at one instant, in lines."""
