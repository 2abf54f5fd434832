"""The live panel: a seat on the running engine inside a notebook."""
