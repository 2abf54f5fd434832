"""Clock, mount, camera and safety monitor of one observatory, and their connection."""
