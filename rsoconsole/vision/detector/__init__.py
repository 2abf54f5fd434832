"""What network, line filter and star search propose, decided, with a confidence."""
