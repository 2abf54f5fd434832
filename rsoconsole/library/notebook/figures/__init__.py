"""The paper's figures, from a session."""
