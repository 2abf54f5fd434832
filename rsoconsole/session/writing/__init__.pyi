from .recording import BatchRecording as BatchRecording
from .rescue import rescue_places as rescue_places
from .writer import SessionWriter as SessionWriter
