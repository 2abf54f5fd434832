from .field import FieldRun as FieldRun
from .field_frame import FieldFrame as FieldFrame
from .field_frame import PlateMode as PlateMode
from .field_frame import open_field_reader as open_field_reader
from .field_points import FEWEST as FEWEST
from .field_report import frame_report as frame_report
from .field_report import movers_report as movers_report
from .field_report import named_movers as named_movers
