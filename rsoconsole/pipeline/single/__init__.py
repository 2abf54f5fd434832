"""Single frames without a track, as ``detect`` and ``solve`` process them."""
