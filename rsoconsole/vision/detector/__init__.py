"""Streak detection: proposals measured, judged and given a confidence."""
