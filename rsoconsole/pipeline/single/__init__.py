"""One frame by itself, without a track: what ``detect`` and ``solve`` do."""
