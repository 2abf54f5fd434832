"""Proposal of Q and R from recorded innovations, with its evidence."""
