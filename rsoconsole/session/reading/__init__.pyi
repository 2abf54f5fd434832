from .clock_history import clock_notes as clock_notes
from .reader import OtherSchemaError as OtherSchemaError
from .reader import SessionReader as SessionReader
from .reader import expect_schema as expect_schema
