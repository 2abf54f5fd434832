"""Proposal of Q and R from recorded innovations, with the evidence for it."""
