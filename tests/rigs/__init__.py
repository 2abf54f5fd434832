"""What holds the product in a test: an engine, a seat, a terminal, instruments of the test's."""
