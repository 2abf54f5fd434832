"""Key actions of the console: each sends one command or asks one question."""
