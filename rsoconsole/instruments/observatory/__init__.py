"""Clock, mount, camera and safety monitor of one observatory, and how they are connected."""
