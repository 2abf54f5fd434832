"""Commands of the operator, their keys, and the terms on the screen."""
