"""The operator's commands, each checked and executed."""
