"""An observatory that speaks INDI. Only cli, tests and the training under models/ import it."""
