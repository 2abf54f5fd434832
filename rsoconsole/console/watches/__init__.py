"""What reads, asks and computes for the screens, each on a thread of its own."""
