"""Everything the operator can do, its keys, and the terms on the screen."""
