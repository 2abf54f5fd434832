"""INDI: by PyIndi or indipyclient in child processes; by plain TCP for STOP, weather and dome."""
