"""The camera, in a process of its own; frames come through shared memory."""
