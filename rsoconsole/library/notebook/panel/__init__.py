"""The live panel: shows the running engine in a notebook and may hold control (a seat)."""
