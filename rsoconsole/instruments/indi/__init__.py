"""INDI: in child processes by PyIndi or indipyclient; by plain TCP for STOP, weather and dome."""
