"""Processes and servers that tests hurt, or that misbehave as tests say."""
