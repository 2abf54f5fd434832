"""Detection and plate solution of single frames, without a track: ``detect`` and ``solve``."""
