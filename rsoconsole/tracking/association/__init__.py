"""What is followed, where its neighbours stand, and how they move against each other."""
