"""The engine put together as a process, and the operator's wire answered."""
