"""The record of a night: one writer, any number of readers."""
