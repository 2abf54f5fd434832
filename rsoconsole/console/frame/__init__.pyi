from .frame_sheet import FrameSheet as FrameSheet
from .sheet_actions import MarkTo as MarkTo
