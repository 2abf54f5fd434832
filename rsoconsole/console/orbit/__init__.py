"""The orbit pane: lines on an orbit at one instant."""
