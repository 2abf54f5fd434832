from .clock_history import clock_notes as clock_notes
from .legacy import LAST_SCHEMA as LAST_SCHEMA
from .legacy import decode_old as decode_old
from .legacy import decode_recorded as decode_recorded
from .legacy import is_without_ids as is_without_ids
from .reader import LaterSchemaError as LaterSchemaError
from .reader import SessionReader as SessionReader
