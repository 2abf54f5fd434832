"""Clock, mount, camera and safety monitor of one observatory, connected."""
