"""Points among star trails: what keeps pace with the telescope while the stars do not."""
