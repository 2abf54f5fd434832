"""Lines and moving points of frames, matched with the catalogued objects that crossed."""
