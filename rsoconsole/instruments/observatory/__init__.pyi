from .clock import utc_now_ns as utc_now_ns
from .connect import connect_instruments as connect_instruments
from .protocols import missing_protocol as missing_protocol
