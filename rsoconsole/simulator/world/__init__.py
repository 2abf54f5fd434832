"""What is imperfect about a simulated night: every imperfection a named setting."""
