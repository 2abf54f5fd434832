"""The camera, by a process of its own; frames come through shared memory."""
