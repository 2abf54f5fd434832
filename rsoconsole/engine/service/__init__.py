"""The engine assembled as a process, and the answers on the operator's wire."""
